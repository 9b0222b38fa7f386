"""A match as plain arrays: how a target's observation and action stand for a core's, whatever was paired with what.

An observation element of the core that the target has as it is, is taken as it is. Every other one is solved for as a linear
combination of the target's positions of the same age, or as the sine or cosine of one; sines and cosines of the target are
first turned into angles with atan2. Ages are times in similar motion; one that the target does not have follows from the two
nearest, along a line. A past action is what the target's past actions are, by the factors of the actions. What has no form
(forces, functions of many joints) only means the same in the same mechanism: all joints match in order, and it has the same
name.

Positions are compared as ways from the reference poses. So a spec matched with itself is the identity, to the bit.
"""

from __future__ import annotations

import itertools
import math
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from transferkit.errors import ConfigError, reason_of
from transferkit.matching.formless import FORMLESS, counterpart
from transferkit.matching.scales import gravity_scale, similarity, steps_of
from transferkit.pairing import Pairing

if TYPE_CHECKING:
    from transferkit.pairing import Combination, Copy
    from transferkit.spec import Actuator, Element, IOSpec

EXACT = 1e-5
"""Share of an action that counts as none."""

SAME_AGE = 0.1
"""Difference of two ages, as a share of them, up to which they count as one."""


@dataclass(frozen=True)
class Match:
    """How a target's observation and action stand for those of each copy of a core.

    With `angles = atan2(obs[sin], obs[cos])` and `z = [obs, angles] @ weight.T + bias`, core input i is z_i, sin(z_i) or
    cos(z_i) as `form` says; the inputs of one copy follow those of another. Action k of the target is
    `action_weight[k] @ core_actions + action_bias[k]`.
    """

    sin: tuple[int, ...]
    cos: tuple[int, ...]
    """Target elements that make an angle, pairwise."""
    weight: tuple[tuple[float, ...], ...]
    """`(copies * d_source, d_target + pairs)`."""
    bias: tuple[float, ...]
    """`(copies * d_source,)`."""
    form: tuple[str, ...]
    """Per core input `linear`, `sin`, `cos`, or `none` if nothing in the target means it."""
    action_weight: tuple[tuple[float, ...], ...]
    """`(target act_dim, copies * source act_dim)`."""
    copies: int = 1
    hold: int = 1
    """Control steps of the target for which an action is held."""
    pairing: Pairing | None = None
    """What it was made from; None for a control that matches nothing."""
    action_bias: tuple[float, ...] = ()
    """`(target act_dim,)`, empty if the middle of every actuator's bounds is where it does nothing."""

    def fits(self, source: IOSpec, target: IOSpec) -> bool:
        """Whether the arrays have the dimensions that the specs need."""
        inputs, width = self.copies * source.obs_dim, target.obs_dim + len(self.sin)
        indices = (*self.sin, *self.cos)
        return (
            self.copies >= 1
            and self.hold >= 1
            and len(self.sin) == len(self.cos)
            and all(0 <= k < target.obs_dim for k in indices)
            and [len(self.weight), len(self.bias), len(self.form)] == [inputs] * 3
            and all(len(row) == width for row in self.weight)
            and len(self.action_weight) == target.act_dim
            and all(len(row) == self.copies * source.act_dim for row in self.action_weight)
            and len(self.action_bias) in (0, target.act_dim)
            and set(self.form) <= {"linear", "sin", "cos", "none"}
            and all(map(math.isfinite, itertools.chain(self.bias, self.action_bias, *self.weight, *self.action_weight)))
        )

    @property
    def holds(self) -> bool:
        """Whether at least one core input and one action mean something in the target."""
        return any(form != "none" for form in self.form) and any(map(any, self.action_weight))


@contextmanager
def numbers_of_robots(source: IOSpec, target: IOSpec) -> Iterator[None]:
    """Turn what numbers that no robot has cause into one line."""
    try:
        yield
    except (ValueError, ArithmeticError) as error:
        raise ConfigError(
            f"{source.env_id} cannot be matched with {target.env_id} ({reason_of(error)})",
            remedy="look at the numbers of both: `transferkit envs show`, `transferkit zoo show`",
        ) from None


def compiled(pairing: Pairing, source: IOSpec, target: IOSpec) -> Match:
    """Find the arrays of a pairing.

    Raises:
        ConfigError: the numbers of the two are none that robots have.
    """
    with numbers_of_robots(source, target):
        pairs = angle_pairs(target)
        basis = _Basis.of(target, pairs)
        rows = [_Rows(copy, pairing, source, target, basis) for copy in pairing.copies]
        inputs = [row for copy in rows for row in copy.inputs()]
        actions = np.concatenate([copy.actions() for copy in rows], axis=1)
        return Match(
            tuple(sin for sin, _ in pairs),
            tuple(cos for _, cos in pairs),
            tuple(tuple(weight.tolist()) for weight, _, _ in inputs),
            tuple(bias for _, bias, _ in inputs),
            tuple(form for _, _, form in inputs),
            tuple(map(tuple, actions.tolist())),
            len(rows),
            pairing.hold,
            pairing,
            tuple(bias.tolist()) if (bias := action_bias(actions, source, target)).any() else (),
        )


def padded(source: IOSpec, target: IOSpec) -> Match:
    """Make the control that matches nothing: element k for element k, zeros if the target has fewer."""
    weight, action = np.eye(source.obs_dim, target.obs_dim), np.eye(target.act_dim, source.act_dim)
    form = tuple("linear" if k < target.obs_dim else "none" for k in range(source.obs_dim))
    rows = [tuple(map(tuple, matrix.tolist())) for matrix in (weight, action)]
    return Match((), (), rows[0], (0.0,) * source.obs_dim, form, rows[1])


def action_bias(factors: NDArray, source: IOSpec, target: IOSpec) -> NDArray:
    """Find what to add to actions `(target act_dim,)`: an action is counted from the middle of its bounds, a force from zero.

    An actuator that nothing drives does nothing, or as little as it can.
    """
    own, others = _stills(source, target), _stills(target, source)
    copies = factors.shape[1] // max(1, source.act_dim)
    bias = np.where(factors.any(axis=1), others - factors @ np.tile(own, copies), np.clip(others, -1.0, 1.0))
    return np.where(np.abs(bias) < EXACT, 0.0, bias)


def _stills(spec: IOSpec, other: IOSpec) -> NDArray:
    """The actions without force; where that is not known, and zero is not the middle, it is as for the other's like."""
    known = {_like(one): one for one in other.action if one.rest is not None}
    unsure = [one.rest is None and bool(one.centre) for one in spec.action]
    return np.array([known.get(_like(one), one).still if k else one.still for k, one in zip(unsure, spec.action, strict=True)])


def _like(actuator: Actuator) -> tuple[str, float, float, float]:
    return actuator.name, actuator.low, actuator.high, actuator.gear


def same_mechanism(source: IOSpec, target: IOSpec, copy: Copy) -> bool:
    """Whether the target's joints are the source's, one for one and in order; their lengths and loads may differ.

    Of something without joints only its own environment is known to be the same.
    """
    if not source.joints:
        return (source.env_id, source.obs_dim, source.act_dim) == (target.env_id, target.obs_dim, target.act_dim)
    pairs = zip(source.joints, target.joints, strict=False)
    in_order = not copy.shift and all(copy.joints.get(own.name) == {other.name: 1.0} for own, other in pairs)
    return in_order and len(source.joints) == len(target.joints) and source.backend == target.backend


def angle_pairs(target: IOSpec) -> list[tuple[int, int]]:
    """Find the indices of observation elements that are sine and cosine of the same angle."""
    sines = {(e.joints, e.coefficients, e.age): i for i, e in enumerate(target.observation) if e.quantity == "sin"}
    pairs = []
    for i, element in enumerate(target.observation):
        if element.quantity != "cos" or element.offset:
            continue
        for sign in (1.0, -1.0):  # the cosine does not know the sign of its angle
            coefficients = tuple(sign * c for c in element.coefficients)
            if (sine := sines.get((element.joints, coefficients, element.age))) is not None:
                pairs.append((sine, i))
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
    """`(d_target + pairs,)`: each position's and velocity's value at zero."""

    @classmethod
    def of(cls, target: IOSpec, pairs: Sequence[tuple[int, int]]) -> _Basis:
        """Collect it."""
        observed = target.observation
        none = np.zeros(len(target.joints))
        angles = [_row(observed[sin], target) for sin, _ in pairs]
        rows = [_row(e, target) if e.quantity == "position" else none for e in observed] + angles
        velocities = [_row(e, target) if e.quantity == "velocity" else none for e in observed] + [none] * len(pairs)
        ages = [e.age for e in observed] + [observed[sin].age for sin, _ in pairs]
        offsets = [e.offset if e.quantity in ("position", "velocity") else 0.0 for e in observed] + [0.0] * len(pairs)
        return cls(np.array(rows), np.array(velocities), np.array(ages), np.array(offsets))

    def solve(self, element: Element, wanted: NDArray, age: float) -> NDArray | None:
        """Find weights over what the target observes that give a combination `(joints,)` of its joints; None if none do.

        An age that the target does not observe follows from the two nearest ones, along a line.
        """
        ages = np.unique(self.ages) if age else np.zeros(1)
        found = [(other, weights) for other in ages if (weights := self._solve_at(element, wanted, other)) is not None]
        found.sort(key=lambda one: abs(one[0] - age))
        if found and found[0][0] == age:
            return found[0][1]
        if len(found) < 2:
            return None
        (one, weights), (other, more) = found[:2]
        return weights + (age - one) / (other - one) * (more - weights)

    def _solve_at(self, element: Element, wanted: NDArray, age: float) -> NDArray | None:
        known = self.velocities if element.quantity == "velocity" else self.rows
        known = known * (self.ages == age)[:, None]
        weights = np.linalg.lstsq(known.T, wanted, rcond=None)[0]
        weights[np.abs(weights) < 1e-9] = 0.0
        return weights if np.allclose(known.T @ weights, wanted, atol=1e-6) else None


def _row(element: Element, spec: IOSpec) -> NDArray:
    return _dense(dict(zip(element.joints, element.coefficients, strict=True)), [joint.name for joint in spec.joints])


def _dense(combination: Combination, names: Sequence[str]) -> NDArray:
    return np.array([combination.get(name, 0.0) for name in names])


Row = tuple[NDArray, float, str]
"""Weights over what the target observes, bias, and form of a core input."""


class _Rows:
    """The inputs and the actions of one copy."""

    def __init__(self, copy: Copy, pairing: Pairing, source: IOSpec, target: IOSpec, basis: _Basis) -> None:
        self._gravity, self._steps = gravity_scale(source, target), steps_of(source, target, pairing.length)
        self._copy, self._scale, self._source, self._target, self._basis = copy, pairing.length, source, target, basis
        self._twin = same_mechanism(source, target, copy)
        self._own = {joint.name: joint for joint in source.joints}
        self._others = {joint.name: joint for joint in target.joints}

    def inputs(self) -> list[Row]:
        """Find every core input."""
        return [self._input(element) for element in self._source.observation]

    def actions(self) -> NDArray:
        """Find the factors `(target act_dim, source act_dim)`; what drives no joint does the same in the same mechanism."""
        names = [actuator.name for actuator in self._source.action]
        weight = np.array([_dense(self._copy.actions.get(one.name, {}), names) for one in self._target.action])
        weight = weight.reshape(self._target.act_dim, self._source.act_dim)
        others = {one.name: k for k, one in enumerate(self._target.action) if one.joint is None}
        for j, actuator in enumerate(self._source.action):
            if self._twin and actuator.joint is None and actuator.name in others:
                weight[others[actuator.name], j] = 1.0
        return weight

    def _input(self, element: Element) -> Row:
        """Read an input as the pairing says, as the target has it, or as what the target has gives it."""
        none = np.zeros(len(self._basis.ages)), 0.0, "none"
        if element.name in self._copy.inputs:
            return self._linear([self._copy.inputs[element.name].get(one.name, 0.0) for one in self._target.observation])
        if element.quantity == "action":
            return self._acted(element) or none
        if element.quantity in FORMLESS:
            place = counterpart(element, self._source, self._target) if self._twin else None
            return none if place is None else self._linear(np.eye(self._target.obs_dim)[place])
        if not element.coefficients or any(name not in self._copy.joints for name in element.joints):
            return none
        return self._taken(element) or self._solved(element) or none

    def _taken(self, element: Element) -> Row | None:
        """Take an element of the target that says the same, but for a factor and what is added."""
        factors = {similarity(element.quantity, self._own[name].type, self._scale, self._gravity) for name in element.joints}
        wanted, age = self._wanted(element, scaled=False), self._age(element)
        for k, other in enumerate(self._target.observation):
            if (other.quantity, other.age) != (element.quantity, age) or len(factors) != 1:
                continue
            factor, rest = max(factors), self._at_zero(element) - max(factors) * other.offset
            changes = element.quantity in ("sin", "cos") and (factor, rest) != (1.0, 0.0)
            if not changes and dict(zip(other.joints, other.coefficients, strict=False)) == wanted:
                return self._linear(factor * np.eye(self._target.obs_dim)[k], rest)
        return None

    def _solved(self, element: Element) -> Row | None:
        """Solve for an element, or for what its sine or cosine is taken of."""
        wanted = self._wanted(element, scaled=True)
        weight = self._basis.solve(element, _dense(wanted, list(self._others)), self._age(element))
        if weight is None:
            return None
        form = element.quantity if element.quantity in ("sin", "cos") else "linear"
        return weight, self._at_zero(element) - float(weight @ self._basis.offsets), form

    def _age(self, element: Element) -> float:
        """How old an element is in control steps of the target, in similar motion."""
        age = element.age * self._steps
        return round(age) if abs(round(age) - age) <= SAME_AGE * age else age

    def _acted(self, element: Element) -> Row | None:
        """Find what the core did in a step from what was done to the target; None if that is not known."""
        names = [one.acted for one in self._source.action]
        if element.name_now not in names:
            return None
        j, factors = names.index(element.name_now), self.actions()
        shares = np.linalg.pinv(factors)[j]
        shares[np.abs(shares) < 1e-9] = 0.0
        if not np.allclose(shares @ factors, np.eye(len(names))[j], atol=1e-6):
            return None
        actuator, added = self._source.action[j], action_bias(factors, self._source, self._target)
        weight, bias = np.zeros(self._target.obs_dim), actuator.centre - actuator.half_range * float(shares @ added)
        done: dict[tuple[str, float], int] = {
            (e.name_now, e.age): k for k, e in enumerate(self._target.observation) if e.quantity == "action"
        }
        for k in np.flatnonzero(shares):
            other = self._target.action[k]
            place = done.get((other.acted, self._age(element)))
            if place is None:
                return None
            weight[place] = shares[k] * actuator.half_range / other.half_range
            bias -= float(weight[place]) * other.centre
        return self._linear(weight, bias)

    def _wanted(self, element: Element, *, scaled: bool) -> dict[str, float]:
        """What a core input is in the target's joints."""
        wanted: dict[str, float] = {}
        for name, coefficient in zip(element.joints, element.coefficients, strict=True):
            factor = similarity(element.quantity, self._own[name].type, self._scale, self._gravity) if scaled else 1.0
            for other, share in self._copy.joints[name].items():
                wanted[other] = wanted.get(other, 0.0) + coefficient * share * factor
        return wanted

    def _at_zero(self, element: Element) -> float:
        """What a core input would be with all of the target's joints at zero."""
        if element.quantity == "velocity":
            return element.offset
        value = element.offset
        for name, coefficient in zip(element.joints, element.coefficients, strict=True):
            factor = similarity("position", self._own[name].type, self._scale, self._gravity)
            read = sum(share * factor * self._others[other].reference for other, share in self._copy.joints[name].items())
            value += coefficient * (self._own[name].reference + self._copy.shift.get(name, 0.0) - read)
        return value

    def _linear(self, weight: Sequence[float] | NDArray, bias: float = 0.0) -> Row:
        """Read a combination of what the target observes, without its angles."""
        return np.concatenate([weight, np.zeros(len(self._basis.ages) - len(weight))]), bias, "linear"
