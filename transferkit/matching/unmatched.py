"""What a match leaves out, on either side, and why."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING, Literal

from transferkit.matching.align import balanced, hindrance
from transferkit.matching.formless import FORMLESS

if TYPE_CHECKING:
    from collections.abc import Collection, Iterator, Sequence

    from transferkit.matching.match import Match
    from transferkit.spec import Actuator, Element, IOSpec, Joint


@dataclass(frozen=True)
class Unmatched:
    """What stands for nothing of the other side."""

    kind: Literal["joint", "core input", "target joint", "action"]
    """A joint of the core's robot, an input of the core, or a joint or an action of the target."""
    name: str
    why: str
    copy: int | None = None
    """From 1: the copy of the core whose joint or input it is."""


def unmatched(match: Match, source: IOSpec, target: IOSpec) -> list[Unmatched]:
    """List what is not matched: of each copy of the core its joints and inputs, then the target's joints and actions."""
    found: list[Unmatched] = []
    copies = () if match.pairing is None else match.pairing.copies
    read = {name for copy in copies for reads in copy.joints.values() for name in reads}
    for k in range(match.copies):
        joints = copies[k].joints if copies else None
        if joints is not None:
            found += [
                Unmatched("joint", *one, k + 1)
                for one in _left_out(source, joints, target, read, _measuring(source, copies[k].inputs))
            ]
        forms = match.form[k * source.obs_dim :][: source.obs_dim]
        inputs = [element for element, form in zip(source.observation, forms, strict=True) if form == "none"]
        found += [Unmatched("core input", element.name, _why(element, joints), k + 1) for element in inputs]
    if copies:
        stand = {name for copy in copies for name in copy.joints}
        named = {name for copy in copies for reads in copy.inputs.values() for name in reads}
        found += [Unmatched("target joint", *one) for one in _left_out(target, read, source, stand, _measuring(target, named))]
    idle = [actuator for actuator, row in zip(target.action, match.action_weight, strict=True) if not any(row)]
    return [*found, *(Unmatched("action", actuator.name, _why_idle(actuator)) for actuator in idle)]


def _why_idle(actuator: Actuator) -> str:
    """Why nothing of the core drives an actuator."""
    return "nothing of the core drives it" + (" (it pushes no joint, or several)" if actuator.joint is None else "")


def _measuring(spec: IOSpec, elements: Collection[str]) -> set[str]:
    """The joints that these elements of an observation measure."""
    return {joint for element in spec.observation if element.name in elements for joint in element.joints}


def _left_out(
    one: IOSpec, matched: Collection[str], other: IOSpec, taken: Collection[str], by_name: Collection[str]
) -> Iterator[tuple[str, str]]:
    """Joints of one robot that are not matched, each with the reason, where some of the other robot's are taken."""
    others = balanced(other.joints)
    free = [joint for joint in others if joint.name not in taken]
    for joint in balanced(one.joints):
        if joint.name not in matched:
            yield joint.name, "it is read by name alone" if joint.name in by_name else _why_left_out(joint, free, others)


def _why_left_out(joint: Joint, free: Sequence[Joint], others: Sequence[Joint]) -> str:
    if lacking := hindrance(joint, others):
        return f"nothing like it is left ({lacking})"
    if hindrance(joint, free):
        return "nothing like it is left (what could stand for it stands for another)"
    return "it is left out, though another could stand for it"


def _why(element: Element, joints: Collection[str] | None) -> str:
    """Why nothing of the target means an element."""
    if joints is None:
        return "the target has none in its place"
    if element.quantity in FORMLESS:
        return f"{element.quantity}, which is the same only in the same mechanism under the same name"
    if missing := [name for name in element.joints if name not in joints]:
        return f"nothing is matched with {', '.join(missing)}"
    return "the target does not observe it"
