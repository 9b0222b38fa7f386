"""A match in words: what every core input and every action of the target was matched with, and what was not, and why."""

from __future__ import annotations

import math
from collections import Counter
from collections.abc import Mapping, Sequence
from typing import TYPE_CHECKING

from transferkit.matching.family import Family, family_of
from transferkit.matching.formless import same_values
from transferkit.matching.limits import limits, unlike
from transferkit.matching.scales import gravity_scale
from transferkit.matching.unmatched import unmatched

if TYPE_CHECKING:
    from transferkit.matching.match import Match
    from transferkit.pairing import Copy, Pairing
    from transferkit.spec import Element, Feedback, IOSpec

KEPT = {
    "acceleration": "an action keeps the acceleration that it causes",
    "load": "an action keeps its torque for the robot's weight and length",
    "greater": "an action keeps its torque for the robot's weight and length, or on a lighter one what its acceleration takes",
}


ACTS: Mapping[Feedback, str] = {
    "": "depends on nothing else",
    "position": "depends on the joint's position, too",
    "velocity": "depends on the joint's velocity, too",
}


NAMED = " (by its name alone)"


def coverage(match: Match, source: IOSpec) -> tuple[float, float]:
    """Compute the share of core inputs that mean something in the target, and of the core's actions that drive something."""
    inputs = sum(form != "none" for form in match.form) / max(1, len(match.form))
    driving = {k % source.act_dim for row in match.action_weight for k, weight in enumerate(row) if weight}
    return inputs, len(driving) / max(1, source.act_dim)


def explain(match: Match, source: IOSpec, target: IOSpec) -> str:
    """Write the scales, and one line for every joint, core input and target action of each copy of the core.

    Joints of the target have a line where nothing reads them.
    """
    lines = [] if match.pairing is None else [_scales(match.pairing, gravity_scale(source, target)), *_family(source, target)]
    left_out = unmatched(match, source, target)
    for k in range(match.copies):
        why = {(one.kind, one.name): f"not matched: {one.why}" for one in left_out if one.copy == k + 1}
        if match.copies > 1:
            lines.append(f"  copy {k + 1} of {match.copies}")
        if match.pairing is not None:
            lines += _joints(match.pairing.copies[k], source, target, why)
        lines += _inputs(match, k, source, target, why)
    unread = [(one.name, target.model_names[one.name], one.why) for one in left_out if one.kind == "target joint"]
    lines += [f"  the target's joint {name} ({model_name}) = not matched: {why}" for name, model_name, why in unread]
    idle = {one.name: one.why for one in left_out if one.kind == "action"}
    lines += [*_actions(match, source, target, idle), *_limits(match, source, target)]
    return "\n".join([*lines, *_unlike(match, source, target)])


def _scales(pairing: Pairing, gravity: float) -> str:
    held = f"; held for {pairing.hold} control steps" if pairing.hold > 1 else ""
    heavier = "" if math.isclose(gravity, 1, rel_tol=5e-3) else f", its gravity {gravity:.3g} times"
    return f"  lengths: the source's are {pairing.length:.3g} times the target's{heavier}; {KEPT[pairing.forces]}{held}"


def _family(source: IOSpec, target: IOSpec) -> list[str]:
    """A line if the core's robot was drawn anew in every episode."""
    family = family_of(source, target)
    lengths, masses = ("{:.3g} to {:.3g}".format(*amount) for amount in family)
    met = f"lengths of {lengths} and masses of {masses} times its own"
    return [] if family == Family() else [f"  family: the core has met {met}, and is scaled to no such body"]


def _joints(copy: Copy, source: IOSpec, target: IOSpec, why: Mapping[tuple[str, str], str]) -> list[str]:
    own, others, lines = source.model_names, _called(target), []
    for name, model_name in own.items():
        reads = _terms({others[other]: share for other, share in copy.joints.get(name, {}).items()})
        shift = f" {copy.shift[name]:+.4g}" if copy.shift.get(name) else ""
        lines.append(f"  joint {name} ({model_name}) = {reads + shift if reads else why['joint', name]}")
    return lines


def _called(spec: IOSpec) -> dict[str, str]:
    """What each joint's model calls it, by canonical name, which is added where several are called so."""
    times = Counter(spec.model_names.values())
    return {name: called if times[called] == 1 else f"{called} {name}" for name, called in spec.model_names.items()}


def _inputs(match: Match, k: int, source: IOSpec, target: IOSpec, why: Mapping[tuple[str, str], str]) -> list[str]:
    names = [e.name for e in target.observation]
    names += [f"atan2({names[s]}, {names[c]})" for s, c in zip(match.sin, match.cos, strict=True)]
    first, lines = k * source.obs_dim, []
    for i, element in enumerate(source.observation):
        weight, bias, form = match.weight[first + i], match.bias[first + i], match.form[first + i]
        terms = _terms({name: w for w, name in zip(weight, names, strict=True) if abs(w) > 1e-9})
        value = terms + (f" {bias:+g}" if abs(bias) > 1e-9 else "")
        value += NAMED if form == "linear" and _by_name(element, weight, target) else ""
        text = {"none": why.get(("core input", element.name)), "linear": value}.get(form, f"{form}({value})")
        lines.append(f"  core input {element.name} = {text}")
    return lines


def _by_name(element: Element, weight: Sequence[float], target: IOSpec) -> bool:
    """Whether nothing but its name says that a function is the core's."""
    reads = [other for other, w in zip(target.observation, weight, strict=False) if w]
    return element.quantity.startswith("function") and not any(same_values(element, other) for other in reads)


def _actions(match: Match, source: IOSpec, target: IOSpec, idle: Mapping[str, str]) -> list[str]:
    names = [f"{a.name}{f'[{k + 1}]' if match.copies > 1 else ''}" for k in range(match.copies) for a in source.action]
    biases, lines = match.action_bias or (0.0,) * target.act_dim, []
    for actuator, row, bias in zip(target.action, match.action_weight, biases, strict=True):
        terms = _terms({name: w for w, name in zip(row, names, strict=True) if w})
        added = f" {bias:+.4g}" if terms and bias else ""
        lines.append(f"  action {actuator.name} = {terms or f'not matched: {idle[actuator.name]}'}{added}")
    return lines


def _limits(match: Match, source: IOSpec, target: IOSpec) -> list[str]:
    """A line for what the target can do little of."""
    lines = []
    for one in limits(match, source, target):
        if one.kind == "joint":
            what = f"joint {one.name} ({source.model_names[one.name]}) reaches {one.share:.0%} of its range"
        else:
            what = f"action {one.name} has {one.share:.0%} of the {'way' if one.kind == 'aim' else 'force'}"
        lines.append(f"  limited: {what}{f' in copy {one.copy}' if one.copy and match.copies > 1 else ''}")
    return lines


def _unlike(match: Match, source: IOSpec, target: IOSpec) -> list[str]:
    """A line for every action that holds where the core's pushes, or the other way round."""
    every = unlike(match, source, target)
    return [f"  differs: the force of action {one.name} {ACTS[one.feedback]}; the core's {ACTS[one.wanted]}" for one in every]


def _terms(combination: Mapping[str, float]) -> str:
    return " ".join(f"{weight:+.4g} {name}" for name, weight in combination.items())
