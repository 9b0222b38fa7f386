"""The card of a core: everything about it but its numbers, as JSON; read without torch.

Fields are described in docs/card.md. `digest` is the hash of the card itself without that field.
"""

from __future__ import annotations

import hashlib
import json
from collections.abc import Mapping
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any

from transferkit.errors import ArtifactError
from transferkit.spec import IOSpec

RESTORE = "restore the folder from its source"

SCHEMA = 1
"""Version of the card this transferkit writes, and the newest it reads."""

CARD, WEIGHTS, PROBE, README = "card.json", "core.safetensors", "probe.safetensors", "README.md"


@dataclass(frozen=True)
class ComponentCard:
    """One network of the core, or the statistics of its source's observations."""

    kind: str
    """`policy`, `critic`, `dynamics` or `normalizer`."""
    architecture: Mapping[str, Any]
    """Everything needed to rebuild it before its weights are loaded."""
    input_end: tuple[str, ...]
    """Tensors that meet the source's observation, which wrapping on another environment makes meaningless."""
    output_end: tuple[str, ...]
    """Tensors that make the source's action."""


@dataclass(frozen=True)
class Score:
    """Deterministic evaluation on the source task."""

    mean: float
    low: float
    high: float
    """95 % interval over members: Student's, or a bootstrap's in older cores."""
    episodes: int
    """Per member."""
    seed: int
    """Seed of the evaluation."""
    members: tuple[float, ...]
    """Mean return of each."""
    threshold: float
    """Every member had to reach it."""


@dataclass(frozen=True)
class Card:
    """See docs/card.md."""

    id: str
    description: str
    source: IOSpec
    components: Mapping[str, ComponentCard]
    """By name; under `parts` in the file."""
    seeds: tuple[int, ...]
    score: Score
    spent: tuple[Mapping[str, float], ...]
    """Per member episodes, steps and seconds of training."""
    command: str
    """Reproduces the artifact."""
    config: Mapping[str, Any]
    """Full training configuration of the first member; the others differ in the seed."""
    versions: Mapping[str, str]
    files: Mapping[str, str]
    """sha256 of every other file of the artifact that is not generated from the card."""
    licence: str = "MIT"
    history: tuple[str, ...] = ()
    schema: int = SCHEMA

    def to_json(self) -> dict[str, Any]:
        """Return JSON-ready data with its digest."""
        data = {**asdict(self), "source": self.source.to_json()}
        data["parts"] = data.pop("components")
        return {**data, "digest": digest(data)}


def read_card(folder: Path) -> Card:
    """Read and check `card.json`: schema version, digest, fields.

    Raises:
        ArtifactError: missing, damaged, tampered with, or from a newer schema.
    """
    path = folder / CARD
    try:
        data = json.loads(path.read_text())
        schema = int(data["schema"])
    except OSError:
        raise ArtifactError(f"{folder} is not a core: it has no {CARD}", topic="cores") from None
    except (ValueError, KeyError, TypeError) as error:
        raise ArtifactError(f"{path} is not a core's card ({error})", remedy=RESTORE) from None
    if schema > SCHEMA:
        raise ArtifactError(
            f"core {folder.name} has card schema {schema}, this transferkit reads up to {SCHEMA}", remedy="upgrade transferkit"
        )
    if data.pop("digest", None) != digest(data):
        raise ArtifactError(f"{path} was changed: its digest does not fit", remedy=RESTORE)
    try:
        return _from_json(data)
    except (KeyError, TypeError) as error:
        raise ArtifactError(f"{path} does not follow card schema {SCHEMA} ({error})", remedy=RESTORE) from None


def digest(data: Mapping[str, Any]) -> str:
    """Compute the sha256 of the canonical JSON of a card without its digest."""
    return hashlib.sha256(json.dumps(data, sort_keys=True, allow_nan=False).encode()).hexdigest()


def sha256(path: Path) -> str:
    """Compute the sha256 of a file."""
    with path.open("rb") as file:
        return hashlib.file_digest(file, "sha256").hexdigest()


def _from_json(data: Mapping[str, Any]) -> Card:
    fields = dict(data)
    fields["source"] = IOSpec.from_json(data["source"])
    fields["components"] = {
        name: ComponentCard(**{**own, "input_end": tuple(own["input_end"]), "output_end": tuple(own["output_end"])})
        for name, own in fields.pop("parts").items()
    }
    fields["score"] = Score(**{**data["score"], "members": tuple(data["score"]["members"])})
    for name in ("seeds", "spent", "history"):
        fields[name] = tuple(data[name])
    return Card(**fields)
