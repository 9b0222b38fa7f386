"""What a descriptor says, in the terms that all formats share."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass
from typing import Literal

from transferkit.reading import FormatError
from transferkit.spec import MOST

Kind = Literal[
    "joint position",
    "joint velocity",
    "body position",
    "linear velocity",
    "angular velocity",
    "gravity",
    "last action",
    "joint torque",
    "other",
]
"""What a number is; commands are positions, velocities or torques of joints."""

AXES = "xyz"


@dataclass(frozen=True)
class Channel:
    """One number of an observation or an action."""

    kind: Kind
    name: str
    """Of the joint in its model, or of the axis, or of whatever it is."""
    scale: float = 1.0
    """The number is `scale * (quantity - zero)`, and a command is `scale * number + zero`."""
    zero: float = 0.0
    """The default pose, in metres or radians, or the command that an output of 0 is."""

    def __str__(self) -> str:
        return self.name if self.kind == "other" else f"{self.kind} {self.name}"


@dataclass(frozen=True)
class Descriptor:
    """What the numbers of a policy are, in order."""

    format: str
    observation: tuple[Channel, ...]
    action: tuple[Channel, ...]
    period: float | None
    """Seconds between actions; None if it does not say."""
    notes: tuple[str, ...] = ()
    """What it says that is not compared."""


def check_size(name: str, size: int) -> None:
    """Refuse more numbers than any environment has, before they are named.

    Raises:
        FormatError: there are.
    """
    if size > MOST:
        raise FormatError(f"{name} has {size} numbers, at most {MOST} are supported")


def channels(kind: Kind, names: Iterable[str], scale: Iterable[float], zero: Iterable[float]) -> list[Channel]:
    """One channel for each name."""
    return [Channel(kind, *one) for one in zip(names, scale, zero, strict=True)]
