"""Match what a core's numbers mean with what a target's mean: which joint is which, and how to compute one from the other.

A source joint matches the first target joint of the same type whose axis is parallel, whose parent is the match of its own
parent, and (for a hinge) whose load rests in the same direction: upright matches upright, never hanging. Signs come from the
axes.

Quantities are scaled by dynamic similarity (Froude): under the same gravity a mechanism `s` times as long moves alike when
lengths scale with s, times with sqrt(s) and accelerations not at all. The length is that from the matched hinges to the
mass they carry, and an action keeps the acceleration it causes. Nothing of it is fitted.

Every observation element of the core is then solved for as a linear combination of the target's positions, or as the
sine or cosine of one; sines and cosines of the target are first turned into angles with atan2.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from transferkit.errors import ConfigError

if TYPE_CHECKING:
    from transferkit.spec import Element, IOSpec, Joint

PARALLEL = 0.99
"""Least cosine between axes that count as the same."""

SAME_REST = 0.7
"""Least cosine between the directions in which two hinges carry their load."""


@dataclass(frozen=True)
class Match:
    """How a target's observation and action stand for a core's, as plain arrays.

    With `angles = atan2(obs[sin], obs[cos])` and `z = [obs, angles] @ weight.T + bias`, core input i is z_i, sin(z_i) or
    cos(z_i) as `form` says. Action k of the target is `action_weight[k] @ core_action`.
    """

    sin: tuple[int, ...]
    cos: tuple[int, ...]
    """Target elements that make an angle, pairwise."""
    weight: tuple[tuple[float, ...], ...]
    """`(d_source, d_target + pairs)`."""
    bias: tuple[float, ...]
    """`(d_source,)`."""
    form: tuple[str, ...]
    """Per core input `linear`, `sin`, `cos`, or `none` if nothing in the target means it."""
    action_weight: tuple[tuple[float, ...], ...]
    """`(target act_dim, source act_dim)`."""
    joints: dict[str, str]
    """Source joint to target joint, for `describe`."""
    scale: float
    """Length of the source over that of the target."""

    @property
    def holds(self) -> bool:
        """Whether at least one core input and one action mean something in the target."""
        return any(form != "none" for form in self.form) and bool(np.any(self.action_weight))


def match(source: IOSpec, target: IOSpec) -> Match:
    """Match a core's source with a target environment."""
    joints = _match_joints(source.joints, target.joints)
    scale = _length_scale(source, target, joints)
    pairs = angle_pairs(target)
    sin, cos = [i for i, _ in pairs], [j for _, j in pairs]
    angle_rows = [_row(target.observation[i], target) for i in sin]
    positions = [_row(e, target) if e.quantity == "position" else None for e in target.observation] + angle_rows
    velocities = [_row(e, target) if e.quantity == "velocity" else None for e in target.observation]
    width = target.obs_dim + len(sin)
    offsets = np.array([e.offset if e.quantity == "position" else 0.0 for e in target.observation] + [0.0] * len(sin))
    weight, bias, form = np.zeros((source.obs_dim, width)), np.zeros(source.obs_dim), []
    for i, element in enumerate(source.observation):
        known = velocities if element.quantity == "velocity" else positions
        solution = _solve(element, source, joints, target, known, scale)
        form.append("none" if solution is None else _form(element.quantity))
        if solution is not None:
            weight[i, : len(solution)] = solution
            bias[i] = element.offset - weight[i] @ offsets * (element.quantity != "velocity")
    action = _match_actions(source, target, joints, scale)
    return Match(
        tuple(sin),
        tuple(cos),
        tuple(map(tuple, weight.tolist())),
        tuple(bias.tolist()),
        tuple(form),
        tuple(map(tuple, action.tolist())),
        {name: joint for name, (joint, _) in joints.items()},
        scale,
    )


def padded(source: IOSpec, target: IOSpec) -> Match:
    """Make the control that matches nothing: element k for element k, zeros if the target has fewer."""
    weight, action = np.eye(source.obs_dim, target.obs_dim), np.eye(target.act_dim, source.act_dim)
    form = tuple("linear" if k < target.obs_dim else "none" for k in range(source.obs_dim))
    rows = [tuple(map(tuple, matrix.tolist())) for matrix in (weight, action)]
    return Match((), (), rows[0], (0.0,) * source.obs_dim, form, rows[1], {}, 1.0)


def match_for(adapter: str, source: IOSpec, target: IOSpec) -> Match | None:
    """Make the match that a kind of adapter asks for; None for a random one.

    Raises:
        ConfigError: a semantic adapter, and nothing matches.
    """
    if adapter == "random":
        return None
    if adapter == "pad":
        return padded(source, target)
    result = match(source, target)
    if result.holds:
        return result
    if adapter == "semantic":
        raise ConfigError(
            f"{{wrap.adapter=semantic}}: nothing in {target.env_id} means what {source.env_id}'s observations and actions mean",
            remedy="use {wrap.adapter=random}",
        )
    return None


def explain(result: Match, source: IOSpec, target: IOSpec) -> str:
    """Write one line for every core input and target action: what it was matched with, or that it was not."""
    names = [e.name for e in target.observation]
    names += [f"atan2({names[s]}, {names[c]})" for s, c in zip(result.sin, result.cos, strict=True)]
    lines = []
    for element, row, bias, form in zip(source.observation, result.weight, result.bias, result.form, strict=True):
        terms = " ".join(f"{w:+.4g} {name}" for w, name in zip(row, names, strict=True) if abs(w) > 1e-9)
        value = terms + (f" {bias:+g}" if abs(bias) > 1e-9 else "")
        text = {"none": "not matched", "linear": value}.get(form, f"{form}({value})")
        lines.append(f"  core input {element.name} = {text}")
    lines.append(f"  lengths: the source's are {result.scale:.3g} times the target's")
    for actuator, row in zip(target.action, result.action_weight, strict=True):
        terms = " ".join(f"{w:+.4g} {a.name}" for w, a in zip(row, source.action, strict=True) if w)
        lines.append(f"  action {actuator.name} = {terms or 'not matched'}")
    return "\n".join(lines)


def _match_joints(source: Sequence[Joint], target: Sequence[Joint]) -> dict[str, tuple[str, float]]:
    """Map source joint names to (target joint name, sign)."""
    matched: dict[str, tuple[str, float]] = {}
    taken: set[str] = set()
    for joint in source:
        if joint.parent is not None and joint.parent not in matched:
            continue
        parent = None if joint.parent is None else matched[joint.parent][0]
        for candidate in target:
            cosine = float(np.dot(joint.axis, candidate.axis))
            same_rest = joint.type == "slide" or float(np.dot(joint.rest, candidate.rest)) >= SAME_REST
            fits = candidate.type == joint.type and candidate.parent == parent and abs(cosine) >= PARALLEL
            if fits and same_rest and candidate.name not in taken:
                matched[joint.name] = candidate.name, float(np.sign(cosine))
                taken.add(candidate.name)
                break
    return matched


def angle_pairs(target: IOSpec) -> list[tuple[int, int]]:
    """Find the indices of observation elements that are sine and cosine of the same angle."""
    sines = {(e.joints, e.coefficients): i for i, e in enumerate(target.observation) if e.quantity == "sin"}
    pairs = []
    for i, element in enumerate(target.observation):
        if element.quantity != "cos" or element.offset:
            continue
        for sign in (1.0, -1.0):  # the cosine does not know the sign of its angle
            coefficients = tuple(sign * c for c in element.coefficients)
            if (element.joints, coefficients) in sines:
                pairs.append((sines[element.joints, coefficients], i))
                break
    return pairs


def _row(element: Element, spec: IOSpec) -> NDArray:
    index = {joint.name: k for k, joint in enumerate(spec.joints)}
    row = np.zeros(len(spec.joints))
    for name, coefficient in zip(element.joints, element.coefficients, strict=True):
        row[index[name]] = coefficient
    return row


def _solve(
    element: Element,
    source: IOSpec,
    joints: dict[str, tuple[str, float]],
    target: IOSpec,
    known: Sequence[NDArray | None],
    scale: float,
) -> NDArray | None:
    """Solve for weights over the known target quantities that give the element's (argument's) joint combination."""
    if not element.coefficients or any(name not in joints for name in element.joints):
        return None
    index = {joint.name: k for k, joint in enumerate(target.joints)}
    types = {joint.name: joint.type for joint in source.joints}
    wanted = np.zeros(len(target.joints))
    for name, coefficient in zip(element.joints, element.coefficients, strict=True):
        partner, sign = joints[name]
        wanted[index[partner]] = coefficient * sign * _similarity(element.quantity, types[name], scale)
    basis = np.array([np.zeros(len(target.joints)) if row is None else row for row in known])
    weights = np.linalg.lstsq(basis.T, wanted, rcond=None)[0]
    weights[np.abs(weights) < 1e-9] = 0.0
    return weights if np.allclose(basis.T @ weights, wanted, atol=1e-6) else None


def _form(quantity: str) -> str:
    return quantity if quantity in ("sin", "cos") else "linear"


def _length_scale(source: IOSpec, target: IOSpec, joints: dict[str, tuple[str, float]]) -> float:
    """Take the geometric mean over the matched hinges."""
    lengths = {joint.name: joint.length for joint in target.joints}
    ratios = [
        joint.length / lengths[joints[joint.name][0]]
        for joint in source.joints
        if joint.name in joints and joint.length > 0 and lengths[joints[joint.name][0]] > 0
    ]
    return float(np.exp(np.mean(np.log(ratios)))) if ratios else 1.0


def _similarity(quantity: str, joint_type: str, scale: float) -> float:
    """Divide the source's value by the target's in similar motion."""
    length, time = (scale if joint_type == "slide" else 1.0), scale**0.5
    return length / time if quantity == "velocity" else length


def _match_actions(source: IOSpec, target: IOSpec, joints: dict[str, tuple[str, float]], scale: float) -> NDArray:
    weight = np.zeros((target.act_dim, source.act_dim))
    for j, actuator in enumerate(source.action):
        if actuator.joint not in joints:
            continue
        partner, sign = joints[actuator.joint]
        for k, candidate in enumerate(target.action):
            if candidate.joint == partner:
                length = scale if candidate.unit == "N m" else 1.0  # angular accelerations scale with 1 / length
                known = actuator.authority and candidate.authority
                weight[k, j] = sign * (length * actuator.authority / candidate.authority if known else 1.0)
    return weight
