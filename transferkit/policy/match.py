"""Match what a core's numbers mean with what a target's mean: which joint is which, and how to compute one from the other.

Quantities are scaled by dynamic similarity (Froude): under the same gravity a mechanism `s` times as long moves alike when
lengths scale with s, times with sqrt(s) and accelerations not at all. The length is that from the matched hinges to the
mass they carry, and an action keeps the acceleration it causes. Nothing of it is fitted.

An observation element of the core that the target has as it is, is taken as it is. Every other one is solved for as a linear
combination of the target's positions of the same age, or as the sine or cosine of one; sines and cosines of the target are
first turned into angles with atan2. What has no form (forces, functions of many joints) only means the same in the same
mechanism: all joints match in order, and it has the same name.

So a spec matched with itself is the identity, to the bit.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from transferkit.errors import ConfigError
from transferkit.policy.joint_match import length_scale, match_joints, same_mechanism

if TYPE_CHECKING:
    from transferkit.policy.joint_match import Joints
    from transferkit.spec import Actuator, Element, IOSpec

FORMLESS = ("height", "function of position", "function of velocity", "force", "action", "time", "constant", "unknown")
"""Quantities that no combination of others gives."""


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
    joints = match_joints(source.joints, target.joints)
    scale = length_scale(source, target, joints)
    pairs = angle_pairs(target)
    basis = _Basis.of(target, pairs)
    weight, bias, form = np.zeros((source.obs_dim, basis.width)), np.zeros(source.obs_dim), []
    twin = same_mechanism(source, target, joints)
    for i, element in enumerate(source.observation):
        k = _counterpart(element, source, target, joints, scale, twin=twin)
        if k is not None:
            weight[i, k[0]] = k[1]
            form.append("linear")
            continue
        solution = _solve(element, source, joints, target, basis, scale)
        form.append("none" if solution is None else _form(element.quantity))
        if solution is not None:
            weight[i] = solution
            bias[i] = element.offset - weight[i] @ basis.offsets * (element.quantity != "velocity")
    action = _match_actions(source, target, joints, scale, twin=twin)
    return Match(
        tuple(sin for sin, _ in pairs),
        tuple(cos for _, cos in pairs),
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


def _counterpart(
    element: Element, source: IOSpec, target: IOSpec, joints: Joints, scale: float, *, twin: bool
) -> tuple[int, float] | None:
    """The target's element that is the source's, and the factor between them."""
    if element.quantity in FORMLESS:
        same = [k for k, other in enumerate(target.observation) if twin and _alike(element, other)]
        return (same[0], 1.0) if same else None
    if any(name not in joints for name in element.joints):
        return None
    types = {joint.name: joint.type for joint in source.joints}
    factors = {_similarity(element.quantity, types[name], scale) for name in element.joints}
    wanted = {joints[name][0]: c * joints[name][1] for name, c in zip(element.joints, element.coefficients, strict=True)}
    key = element.quantity, element.age, wanted, element.offset
    for k, other in enumerate(target.observation):
        has = other.quantity, other.age, dict(zip(other.joints, other.coefficients, strict=False)), other.offset
        if has == key and len(factors) == 1 and not (element.offset and factors != {1.0}):
            return k, factors.pop()
    return None


def _alike(element: Element, other: Element) -> bool:
    """Whether two elements without a form say the same; what they respond to is found with random states and may differ."""
    return all(getattr(element, name) == getattr(other, name) for name in ("name", "quantity", "unit", "age"))


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


@dataclass(frozen=True)
class _Basis:
    """What a target observes of its joints."""

    rows: NDArray
    """`(d_target + pairs, joints)`: each position's slopes; zero for anything else."""
    velocities: NDArray
    """As `rows`, of each velocity."""
    ages: NDArray
    """`(d_target + pairs,)`."""
    offsets: NDArray
    """`(d_target + pairs,)`: each position's value at zero."""

    @property
    def width(self) -> int:
        """Columns of the weight that a core input has."""
        return len(self.ages)

    @classmethod
    def of(cls, target: IOSpec, pairs: Sequence[tuple[int, int]]) -> _Basis:
        """Collect it."""
        observed = target.observation
        none = np.zeros(len(target.joints))
        angles = [_row(observed[sin], target) for sin, _ in pairs]
        rows = [_row(e, target) if e.quantity == "position" else none for e in observed] + angles
        velocities = [_row(e, target) if e.quantity == "velocity" else none for e in observed] + [none] * len(pairs)
        ages = [e.age for e in observed] + [observed[sin].age for sin, _ in pairs]
        offsets = [e.offset if e.quantity == "position" else 0.0 for e in observed] + [0.0] * len(pairs)
        return cls(np.array(rows), np.array(velocities), np.array(ages), np.array(offsets))


def _row(element: Element, spec: IOSpec) -> NDArray:
    index = {joint.name: k for k, joint in enumerate(spec.joints)}
    row = np.zeros(len(spec.joints))
    for name, coefficient in zip(element.joints, element.coefficients, strict=True):
        row[index[name]] = coefficient
    return row


def _solve(element: Element, source: IOSpec, joints: Joints, target: IOSpec, basis: _Basis, scale: float) -> NDArray | None:
    """Solve for weights over what the target observes that give the element's (argument's) joint combination."""
    if not element.coefficients or any(name not in joints for name in element.joints):
        return None
    index = {joint.name: k for k, joint in enumerate(target.joints)}
    types = {joint.name: joint.type for joint in source.joints}
    wanted = np.zeros(len(target.joints))
    for name, coefficient in zip(element.joints, element.coefficients, strict=True):
        partner, sign = joints[name]
        wanted[index[partner]] = coefficient * sign * _similarity(element.quantity, types[name], scale)
    known = basis.velocities if element.quantity == "velocity" else basis.rows
    known = known * (basis.ages == element.age)[:, None]
    weights = np.linalg.lstsq(known.T, wanted, rcond=None)[0]
    weights[np.abs(weights) < 1e-9] = 0.0
    return weights if np.allclose(known.T @ weights, wanted, atol=1e-6) else None


def _form(quantity: str) -> str:
    return quantity if quantity in ("sin", "cos") else "linear"


def _similarity(quantity: str, joint_type: str, scale: float) -> float:
    """Divide the source's value by the target's in similar motion."""
    length, time = (scale if joint_type == "slide" else 1.0), scale**0.5
    return length / time if quantity == "velocity" else length


def _match_actions(source: IOSpec, target: IOSpec, joints: Joints, scale: float, *, twin: bool) -> NDArray:
    """Each source actuator's acceleration, from the target actuators that drive the same joint together."""
    weight = np.zeros((target.act_dim, source.act_dim))
    names = {actuator.name: k for k, actuator in enumerate(target.action)}
    for j, actuator in enumerate(source.action):
        alike = names.get(actuator.name) if twin else None
        if alike is not None and actuator.joint == target.action[alike].joint:
            weight[alike, j] = _shares(actuator, [target.action[alike]], 1.0, scale)[0]
        elif actuator.joint in joints:
            partner, sign = joints[actuator.joint]
            driving = [k for k, candidate in enumerate(target.action) if candidate.joint == partner]
            weight[driving, j] = _shares(actuator, [target.action[k] for k in driving], sign, scale)
    return weight


def _shares(actuator: Actuator, driving: Sequence[Actuator], sign: float, scale: float) -> list[float]:
    """The action of each of those that drive a joint together, for an action of 1 of the source's."""
    together = sum(abs(one.authority) for one in driving)
    if not (actuator.authority and together):
        return [sign for _ in driving]
    length = scale if driving[0].unit == "N m" else 1.0  # angular accelerations scale with 1 / length
    return [sign * length * actuator.authority / together * float(np.sign(one.authority)) for one in driving]
