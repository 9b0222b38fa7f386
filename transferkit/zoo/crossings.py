"""What the cores of a zoo do untrained on other environments, as a study measured it."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from transferkit.errors import ArtifactError
from transferkit.reading import FormatError, parse, read_bytes, typed, unsealed
from transferkit.zoo.card import LARGEST_CARD, RESTORE

CROSSINGS = "crossings.json"
"""A file of a zoo's folder."""


@dataclass(frozen=True)
class Crossing:
    """A core on an environment that is not its own, before any training there; all are mean returns."""

    target: str
    members: tuple[float, ...]
    zero: float
    """Of doing nothing."""
    control: str
    """The best of all controls: doing nothing, random actions, a random core, a shuffled one."""
    control_mean: float

    @property
    def mean(self) -> float:
        """Over members."""
        return sum(self.members) / len(self.members)

    @property
    def crosses(self) -> bool:
        """Whether every member is above every control."""
        return min(self.members) > self.control_mean


@dataclass(frozen=True)
class Crossings:
    """The file."""

    study: str
    """A folder of the experiments."""
    episodes: int
    """Of each member on each target."""
    cores: Mapping[str, Sequence[Crossing]]
    """By id."""


def read_crossings(zoo: Path) -> Crossings | None:
    """Read what is known of a zoo's cores; None if nothing is.

    Raises:
        ArtifactError: the file is damaged.
    """
    path = zoo / CROSSINGS
    try:
        return typed(unsealed(parse(read_bytes(path, LARGEST_CARD, follow=False), dict[str, Any]), required=True), Crossings)
    except FileNotFoundError:
        return None
    except OSError as error:
        raise ArtifactError(f"{path} cannot be read: {error.strerror}") from None
    except FormatError as error:
        raise ArtifactError(f"{path} is damaged ({error})", remedy=RESTORE) from None
