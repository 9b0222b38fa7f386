"""What a descriptor says beside what the physics of an environment say: the check of joint orders that people do by hand."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, Literal

from transferkit.descriptors.form import AXES

if TYPE_CHECKING:
    from transferkit.descriptors.form import Channel, Descriptor, Kind
    from transferkit.spec import Actuator, Element, IOSpec, Joint

TOLERANCE = 1e-3
"""Relative, of scales, and absolute, of zeros."""

DEGREES = 180 / math.pi

QUANTITIES: dict[Kind, str] = {
    "joint position": "position",
    "joint velocity": "velocity",
    "body position": "position",
    "linear velocity": "velocity",
    "angular velocity": "velocity",
    "last action": "action",
    "gravity": "function of position",
}

Verdict = Literal["agrees", "order", "sign", "unit", "scale", "zero", "kind", "missing", "not compared"]


@dataclass(frozen=True)
class Row:
    """One number."""

    part: Literal["observation", "action", "period"]
    index: int
    described: str
    """By the descriptor; empty if it has no such number."""
    measured: str
    """In the environment; empty if that has none."""
    verdict: Verdict
    detail: str = ""
    """What differs."""

    @property
    def differs(self) -> bool:
        """Whether the descriptor is known to say something else."""
        return self.verdict not in ("agrees", "not compared")


def compare(descriptor: Descriptor, spec: IOSpec) -> list[Row]:
    """Compare every number of observation and action, in order, with the spec of an environment."""
    rows = [*_rows("observation", descriptor.observation, observed(spec)), *_rows("action", descriptor.action, driven(spec))]
    if descriptor.period is not None and spec.time_step:
        same = math.isclose(descriptor.period, spec.time_step, rel_tol=TOLERANCE)
        texts = f"{descriptor.period:g} s an action", f"{spec.time_step:g} s an action"
        rows.append(Row("period", 0, *texts, "agrees" if same else "scale"))
    return rows


def observed(spec: IOSpec) -> list[Measured]:
    """The numbers of an observation."""
    return [_observed(element, spec) for element in spec.observation]


def driven(spec: IOSpec) -> list[Measured]:
    """The numbers of an action."""
    return [_driven(actuator, spec) for actuator in spec.action]


@dataclass(frozen=True)
class Measured:
    """A number of the environment: it is `scale * (quantity - zero)`, a command makes `scale` times itself."""

    text: str
    quantity: str
    joints: tuple[Joint, ...]
    scale: float = 1.0
    zero: float = 0.0

    def is_of(self, channel: Channel) -> bool:
        """Whether both are of the same quantity, and of the same joint or axis."""
        if channel.kind == "gravity":
            return self.quantity == QUANTITIES[channel.kind]
        if QUANTITIES.get(channel.kind, "torque") != self.quantity or len(self.joints) != 1:
            return False
        (joint,) = self.joints
        if channel.kind in ("body position", "linear velocity", "angular velocity"):
            hinge = channel.kind == "angular velocity"
            along = channel.name in AXES and abs(joint.axis[AXES.index(channel.name)]) > 1 - TOLERANCE
            return along and (joint.type == "hinge") == hinge and (joint.parent is None or not hinge or joint.length > 0)
        return channel.name in (joint.model_name, joint.name)


def _rows(part: Literal["observation", "action"], said: Sequence[Channel], found: Sequence[Measured]) -> list[Row]:
    rows = []
    for k in range(max(len(said), len(found))):
        channel, measured = said[k] if k < len(said) else None, found[k] if k < len(found) else None
        text = "" if channel is None else str(channel), "" if measured is None else measured.text
        rows.append(Row(part, k, *text, *_verdict(channel, measured, found, action=part == "action")))
    return rows


def _verdict(
    channel: Channel | None, measured: Measured | None, found: Sequence[Measured], *, action: bool
) -> tuple[Verdict, str]:
    if channel is None:
        return "missing", "the descriptor has no such number"
    if channel.kind == "other":
        return "not compared", ""
    if measured is not None and measured.is_of(channel):
        plain = channel.kind in ("gravity", "last action")
        differences = [] if plain else _differences(channel, measured, action=action)
        return (differences[0][0], _joined(differences)) if differences else ("agrees", "")
    places = [k for k, other in enumerate(found) if other.is_of(channel)]
    if places and channel.kind != "gravity":
        differences = [] if channel.kind == "last action" else _differences(channel, found[places[0]], action=action)
        more = [("order", f"the environment has it at {places[0]}"), *differences]
        return "order", _joined(more)
    if action and measured is not None and channel.kind != "joint torque":
        return "kind", "the environment takes torques"
    return "missing", "the environment has no such number"


def _differences(channel: Channel, measured: Measured, *, action: bool) -> list[tuple[Verdict, str]]:
    """Compare signs, units or scales, and zeros of the same quantity."""
    if not measured.scale or not channel.scale:
        return [("not compared", "")]
    found, ratio = list[tuple[Verdict, str]](), channel.scale / measured.scale
    if ratio < 0:
        found.append(("sign", f"{channel.scale:g} against {measured.scale:g}"))
    units = [factor for factor in (DEGREES, 1 / DEGREES) if math.isclose(abs(ratio), factor, rel_tol=TOLERANCE)]
    if units:
        found.append(("unit", "degrees against radians" if units[0] > 1 else "radians against degrees"))
    elif not math.isclose(abs(ratio), 1.0, rel_tol=TOLERANCE):
        unit = " N m for 1" if action else ""
        found.append(("scale", f"{abs(channel.scale):g} against {abs(measured.scale):g}{unit}"))
    if abs(channel.zero - measured.zero) > TOLERANCE:
        found.append(("zero", f"{channel.zero:g} against {measured.zero:g}"))
    return found


def _joined(differences: Sequence[tuple[Verdict, str]]) -> str:
    """What the first one is, and which others there are."""
    first, *others = differences
    return "; ".join([first[1], *(f"{verdict} {words}" for verdict, words in others)])


def _observed(element: Element, spec: IOSpec) -> Measured:
    named = {joint.name: joint for joint in spec.joints}
    joints = tuple(named[name] for name in element.joints)
    scale = element.coefficients[0] if len(element.coefficients) == 1 else 1.0
    zero = 0.0 - element.offset / scale if scale else 0.0
    quantity = element.quantity if not element.age or element.quantity == "action" else "earlier"
    if element.quantity == "action":
        own = [one.joint for one in spec.action if element.name_now == one.acted]
        joints = tuple(named[joint] for joint in own if joint is not None)
    names = " + ".join(joint.model_name for joint in joints) or element.name
    return Measured(f"{element.quantity} of {names}", quantity, joints, scale, zero)


def _driven(actuator: Actuator, spec: IOSpec) -> Measured:
    joints = tuple(joint for joint in spec.joints if joint.name == actuator.joint)
    text = f"torque of {joints[0].model_name}" if joints else actuator.model_name or actuator.name
    return Measured(text, "torque", joints, actuator.gear)
