"""The card of a core: everything about it but its numbers, as JSON; read without torch.

Fields are described in docs/card.md.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Annotated, Any, TypedDict

import msgspec

from transferkit.errors import ArtifactError
from transferkit.reading import Count, FormatError, parse, read_bytes, typed, unsealed
from transferkit.spec import IOSpec

RESTORE = "restore the folder from its source"

SCHEMA = 1
"""Version of the card this transferkit writes, and the newest it reads."""

CARD, WEIGHTS, PROBE, README = "card.json", "core.safetensors", "probe.safetensors", "README.md"

SCORE_SEED = 1
"""Evaluation seed of the stated score; evaluations during training use 0."""

SCORE_EPISODES = 20

NOT_STATED = "not stated"
"""A licence that nobody named."""

LARGEST_CARD = 4 * 2**20
"""Bytes."""

LARGEST = 256 * 2**20
"""Bytes of the weights, or of the probe."""

Sha256 = Annotated[str, msgspec.Meta(pattern="^[0-9a-f]{64}$")]
CoreId = Annotated[str, msgspec.Meta(pattern=r"^\w[\w.+() -]{0,100}$")]


@dataclass(frozen=True)
class ComponentCard:
    """One network of the core, or the statistics of its source's observations."""

    kind: str
    """`policy`, `critic`, `dynamics`, `normalizer`, or one that a later version knows."""
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
    episodes: Annotated[int, msgspec.Meta(ge=1, le=1000)]
    """Per member."""
    seed: Count
    """Seed of the evaluation."""
    members: tuple[float, ...]
    """Mean return of each."""
    threshold: float
    """Every member had to reach it."""


class Training(TypedDict):
    """What a member's training took."""

    episodes: Count
    steps: Count
    seconds: float


@dataclass(frozen=True)
class ImportedFrom:
    """The file that a core was imported from."""

    library: str
    """That wrote it."""
    sha256: Sha256


@dataclass(frozen=True)
class Card:
    """See docs/card.md."""

    id: CoreId
    description: str
    source: IOSpec
    components: Mapping[str, ComponentCard]
    """By name; under `parts` in the file."""
    seeds: Annotated[tuple[Count, ...], msgspec.Meta(min_length=1, max_length=1000)]
    score: Score
    spent: tuple[Training, ...]
    """Per member."""
    command: str
    """Reproduces the artifact."""
    config: Mapping[str, Any]
    """Full training configuration of the first member; the others differ in the seed."""
    versions: Mapping[str, str]
    files: Mapping[str, Sha256]
    """sha256 of `core.safetensors` and of `probe.safetensors`; the README is generated from the card."""
    licence: str = "MIT"
    history: tuple[str, ...] = ()
    origin: ImportedFrom | None = None
    """If another library trained it."""
    schema: Annotated[int, msgspec.Meta(ge=1, le=SCHEMA)] = SCHEMA
    digest: str = ""
    """sha256 of all other fields as canonical JSON; empty until it is written."""

    def __post_init__(self) -> None:
        if not len(self.seeds) == len(self.score.members) == len(self.spent):
            raise ValueError("seeds, scores and what was spent are of different numbers of members")
        if "policy" not in self.components:
            raise ValueError("it has no policy")

    def to_json(self) -> dict[str, Any]:
        """Return JSON-ready data."""
        data = asdict(self)
        data["parts"] = data.pop("components")
        return data


def read_card(folder: Path) -> Card:
    """Read and check `card.json`: digest, schema version, fields.

    Raises:
        ArtifactError: missing, damaged, tampered with, or from a newer schema.
    """
    path = folder / CARD
    try:
        data = parse(read_bytes(path, LARGEST_CARD, follow=False), dict[str, Any])
        unsealed(data, required=True)
        schema = data.get("schema")
        if isinstance(schema, int) and schema > SCHEMA:
            newer = f"core {folder.name} has card schema {schema}, this transferkit reads up to {SCHEMA}"
            raise ArtifactError(newer, remedy="upgrade transferkit")
        return typed({**data, "components": data.get("parts")}, Card)
    except FileNotFoundError:
        if not folder.is_dir():
            raise ArtifactError(f"there is no folder {folder}", remedy="name a core's folder", topic="cores") from None
        raise ArtifactError(f"{folder} holds no {CARD}", remedy="name a core's folder", topic="cores") from None
    except OSError as error:
        raise ArtifactError(f"{path} cannot be read: {error.strerror}") from None
    except FormatError as error:
        raise ArtifactError(f"{path} is not a core's card ({error})", remedy=RESTORE) from None
