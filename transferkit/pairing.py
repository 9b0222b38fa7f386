"""The decisions of a match, as data that a person may read, edit and hand back: what reads what, and what drives what."""

from __future__ import annotations

import math
from collections.abc import Iterable
from dataclasses import dataclass, field
from typing import Literal

Limbs = Literal["one", "all"]
"""Whether one limb of the source drives one limb of the target, or all that are like it."""

Angles = Literal["own", "carried"]
"""Whether a hinge whose partner carries more hinges than it does reads the partner's own angle, or that of all it carries."""

Kept = Literal["acceleration", "load", "greater"]
"""What an action keeps: the acceleration that it causes, its torque for the robot's weight and length (load), or the load but
on a lighter robot no less than the acceleration takes (greater)."""

Forces = Literal["auto", "acceleration", "load", "greater"]
"""How that is chosen: auto takes the load, and greater takes greater, if both robots stand on their limbs; else both take the
acceleration."""

Combination = dict[str, float]
"""Coefficients by name."""


LARGEST = 1e9
"""Absolute value that no number of a match exceeds."""

MOST_HELD = 10_000
"""Control steps for which an action may be held."""


@dataclass(frozen=True)
class Copy:
    """One copy of the core on the target."""

    joints: dict[str, Combination] = field(default_factory=dict)
    """What each source joint that is matched reads: target joints, with signs."""
    actions: dict[str, Combination] = field(default_factory=dict)
    """What drives each target actuator: source actuators, with the factors of their actions."""
    shift: Combination = field(default_factory=dict)
    """Metres or radians that are added to what a source joint reads."""
    inputs: dict[str, Combination] = field(default_factory=dict)
    """Core inputs that are read from elements of the target's observation, by name, whatever the joints say."""


@dataclass(frozen=True)
class Pairing:
    """How a core stands on a target; everything else of a match follows from it and the two specs."""

    source: str
    """Environment of the core."""
    target: str
    copies: tuple[Copy, ...]
    length: float = 1.0
    """Lengths of the source over those of the target."""
    hold: int = 1
    """Control steps of the target for which an action is held."""
    forces: Kept = "acceleration"
    """How the factors of the actions were found."""

    def __post_init__(self) -> None:
        if not (math.isfinite(self.length) and self.length > 0):
            raise ValueError(f"its length is {self.length}, and must be greater than 0")
        if not 1 / LARGEST <= self.length <= LARGEST:
            raise ValueError(f"its length is {self.length:g}, and must be between {1 / LARGEST:g} and {LARGEST:g}")
        if not 1 <= self.hold <= MOST_HELD:
            raise ValueError(f"its hold is {self.hold} control steps, and must be between 1 and {MOST_HELD:,}")
        numbers = [x for copy in self.copies for part in vars(copy).values() for one in part.values() for x in _numbers(one)]
        if not all(map(math.isfinite, numbers)):
            raise ValueError("its numbers must be finite")
        if (largest := max(map(abs, numbers), default=0.0)) > LARGEST:
            raise ValueError(f"it has the number {largest:g}, and its numbers must be {LARGEST:g} at most")
        if not 1 <= len(self.copies) <= 64:
            raise ValueError(f"it has {len(self.copies)} copies, and must have 1 to 64")


def _numbers(value: float | Combination) -> Iterable[float]:
    return value.values() if isinstance(value, dict) else (value,)
