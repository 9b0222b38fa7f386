"""Isaac Lab's IO descriptors (`export_IODescriptors.py`): lists of action terms and of observation terms."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from typing import TYPE_CHECKING, Annotated, Any, TypeAlias

import msgspec

from transferkit.descriptors.form import AXES, Channel, Descriptor, channels, check_size
from transferkit.reading import FormatError, Size, typed

if TYPE_CHECKING:
    from transferkit.descriptors.form import Kind

Numbers: TypeAlias = Any
"""None, one for all, one for each, or one for each in a row of its own, as a tensor over one environment is written."""

OBSERVATIONS: Mapping[str, Kind] = {
    "joint_pos": "joint position",
    "joint_pos_rel": "joint position",
    "joint_vel": "joint velocity",
    "joint_vel_rel": "joint velocity",
    "base_lin_vel": "linear velocity",
    "base_ang_vel": "angular velocity",
    "projected_gravity": "gravity",
    "last_action": "last action",
}
"""By the name of the function that computes the term."""

ACTIONS: Mapping[str, Kind] = {
    "joint_position_action": "joint position",
    "joint_velocity_action": "joint velocity",
    "joint_effort_action": "joint torque",
}


@dataclass(frozen=True)
class Overloads:
    """What is done to a term, in this order: clip, scale, history."""

    clip: tuple[float, float] | None = None
    scale: Numbers = None
    history_length: Annotated[int, msgspec.Meta(ge=0, le=1000)] = 0


@dataclass(frozen=True)
class Observation:
    """An observation term."""

    name: str
    shape: tuple[Size, ...] | None = None
    joint_names: tuple[str, ...] = ()
    joint_pos_offsets: tuple[float, ...] = ()
    joint_vel_offsets: tuple[float, ...] = ()
    overloads: Overloads = field(default_factory=Overloads)


@dataclass(frozen=True)
class Action:
    """An action term."""

    name: str
    shape: tuple[Size, ...] | None = None
    joint_names: tuple[str, ...] = ()
    scale: Numbers = None
    offset: Numbers = None
    clip: Any = None


@dataclass(frozen=True)
class Scene:
    """Of the simulation."""

    dt: Annotated[float, msgspec.Meta(gt=0)]
    """Seconds between actions."""


@dataclass(frozen=True)
class IODescriptors:
    """The file; `articulations` repeat what the terms say."""

    actions: tuple[Action, ...]
    observations: Mapping[str, tuple[Observation, ...]]
    scene: Scene | None = None


def read_isaac(file: IODescriptors) -> Descriptor:
    """Take its one group of observations, `policy` if there are several.

    Raises:
        FormatError: it has none, or a term is not of the length that it says.
    """
    groups = file.observations
    if not groups or (len(groups) > 1 and "policy" not in groups):
        raise FormatError(f"it has the groups of observations {sorted(groups)}, and none is named policy")
    terms = groups["policy"] if "policy" in groups else next(iter(groups.values()))
    action = [channel for term in file.actions for channel in _action(term)]
    observation = [channel for term in terms for channel in _observation(term, action)]
    clipped = [term.name for term in terms if term.overloads.clip is not None]
    notes = (f"clips of {', '.join(clipped)} are not compared",) if clipped else ()
    period = None if file.scene is None else file.scene.dt
    return Descriptor("Isaac Lab's IO descriptors", tuple(observation), tuple(action), period, notes)


def _observation(term: Observation, action: Sequence[Channel]) -> list[Channel]:
    kind = OBSERVATIONS.get(term.name, "other")
    size = term.shape[-1] if term.shape else len(term.joint_names)
    if not size:
        raise FormatError(f"term {term.name} has neither a shape nor joint names")
    past = term.overloads.history_length
    check_size(term.name, size * max(1, past))
    names = list(term.joint_names)
    if kind in ("linear velocity", "angular velocity", "gravity"):
        names = list(AXES)
    elif kind == "last action":
        names = [channel.name for channel in action]
    elif term.name == "base_pos_z":
        kind, names = "body position", ["z"]
    if len(names) != size:
        kind, names = "other", [term.name if size == 1 else f"{term.name}[{k}]" for k in range(size)]
    zeros = _each(list(term.joint_pos_offsets or term.joint_vel_offsets) or None, size, term.name)
    once = channels(kind, names, _each(term.overloads.scale, size, term.name, default=1.0), zeros)
    return once if past < 2 else [*(Channel("other", f"{one.name}, earlier") for one in once * (past - 1)), *once]


def _action(term: Action) -> list[Channel]:
    kind, names = ACTIONS.get(term.name, "other"), list(term.joint_names)
    size = term.shape[-1] if term.shape else len(names)
    check_size(term.name, size)
    if not names:
        names = [f"{term.name}[{k}]" for k in range(size)]
    if len(names) != size:
        raise FormatError(f"action term {term.name} has {size} numbers and {len(names)} joints")
    scale, offset = (_each(one, size, term.name, default) for one, default in ((term.scale, 1.0), (term.offset, 0.0)))
    return channels(kind, names, scale, offset)


def _each(numbers: Numbers, size: int, name: str, default: float = 0.0) -> list[float]:
    """One number for each of a term's."""
    if numbers is None:
        return [default] * size
    if isinstance(numbers, float | int):
        return [float(numbers)] * size
    each = numbers[0] if isinstance(numbers, list) and len(numbers) == 1 and isinstance(numbers[0], list) else numbers
    listed = list(typed(each, tuple[float, ...]))
    if len(listed) != size:
        raise FormatError(f"term {name} has {size} numbers, and {len(listed)} scales or offsets")
    return listed
