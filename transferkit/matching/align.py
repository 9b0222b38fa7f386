"""Which joint of a target stands for which of a source: the alignment of their kinematic trees that costs least.

A joint may stand for one of the same type about a parallel axis, whose load does not rest on the other side: upright never
stands for hanging. What hangs on a joint stands for what hangs on its partner, and joints may be left out on either side, at a
price. Disjoint limbs stand for disjoint limbs (the constrained edit distance of unordered trees, Zhang 1996), so the least
cost is found exactly, by assignments of limbs to limbs (`scipy.optimize.linear_sum_assignment`).
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cache
from typing import TYPE_CHECKING, NamedTuple

import numpy as np
from scipy.optimize import linear_sum_assignment

from transferkit.matching.tree import below, kinematic_tree, parallel

if TYPE_CHECKING:
    from transferkit.matching.tree import Tree
    from transferkit.spec import IOSpec, Joint

GAP = 1.0
"""Price of a joint that is left out."""

BETWEEN = 0.3
"""What it costs more if that joint carries some that are not left out."""

LIKE = 0.5
"""A limb is like another if to align them costs at most this share of leaving both out."""

WEIGHTS = {
    "rest": 0.5,
    "length": 0.2,
    "mass": 0.1,
    "range": 0.3,
    "driven": 0.3,
    "strength": 0.1,
    "place": 0.5,
    "side": 0.03,
    "name": 0.02,
    "order": 0.01,
}
"""Price of each kind of difference between two joints, for a difference of one. Joints that may stand for each other and differ
in nearly all of them still cost less than two gaps."""

FARTHEST = 0.8
"""Largest difference of where two loads rest, as one minus the cosine of the angle between them."""

BESIDE = 0.02
"""How far from a middle plane, as a share of the robot's size, a joint still lies on neither side of it."""

BALANCED = 0.03
"""How far a load's centre of mass is from its joint, as a share of the robot's size, if it is all but balanced there."""

LARGEST = 2.0
"""Bound of the logarithms of ratios."""


class Alignment(NamedTuple):
    """What stands for what, and what it costs."""

    cost: float
    pairs: tuple[tuple[str, str], ...]


@dataclass(frozen=True)
class Feature:
    """What is compared of a joint; what is not known is NaN."""

    joint: Joint
    length: float
    """Of the longest in its spec."""
    mass: float
    """Of the heaviest load in its spec."""
    torque: float
    """Of the strongest in its spec, with the actuators of one joint together; 0 if it is not driven."""
    place: float
    """0 at the world, 1 at a joint that carries none: the share of the way between, in metres or else in joints."""
    side: tuple[float, float]
    """Forwards and to the left: 1 in front of, or left of, where the driven trees begin, -1 behind it, or right, else 0."""
    order: float
    """Between 0 and 1: only what is alike in everything else is taken in order."""


def align(source: IOSpec, target: IOSpec) -> Alignment:
    """Find the alignment of two specs' joints that costs least."""
    return Aligner(source, target).of(None, None)


class Aligner:
    """Alignments of parts of two kinematic trees."""

    def __init__(self, source: IOSpec, target: IOSpec) -> None:
        self.trees = kinematic_tree(source.joints), kinematic_tree(target.joints)
        metric = all(joint.anchor is not None for joint in (*source.joints, *target.joints))
        self._features = tuple(
            _features(spec, tree, metric=metric) for spec, tree in zip((source, target), self.trees, strict=True)
        )
        self._sizes = [{name: len(below(tree, name)) for name in tree if name} for tree in self.trees]
        self.of = cache(self._forests)
        self.limb = cache(self._trees)

    def price(self, one: str, other: str) -> float:
        """What it costs that one joint stands for another; infinite if it cannot."""
        return difference(self._features[0][one], self._features[1][other])

    def alike(self, one: str, other: str) -> bool:
        """Whether two limbs are so much alike that one may stand for several."""
        return self.limb(one, other).cost <= LIKE * GAP * (self._sizes[0][one] + self._sizes[1][other])

    def drives(self, side: int, limb: str) -> bool:
        """Whether anything of a limb of the source (0) or of the target (1) is driven."""
        return any(self._features[side][name].torque > 0 for name in below(self.trees[side], limb))

    def _trees(self, one: str, other: str) -> Alignment:
        """Align a joint and all it carries with another and all it carries."""
        inner = self.of(one, other)
        both = Alignment(self.price(one, other) + inner.cost, ((one, other), *inner.pairs))
        sizes = self._sizes[0][one], self._sizes[1][other]
        skipped = [self._skip(self.limb(child, other), sizes[0] - self._sizes[0][child]) for child in self.trees[0][one]]
        skipped += [self._skip(self.limb(one, child), sizes[1] - self._sizes[1][child]) for child in self.trees[1][other]]
        return min([both, *skipped, Alignment(GAP * sum(sizes), ())], key=_cost)

    def _forests(self, one: str | None, other: str | None) -> Alignment:
        """Align what a joint carries with what another carries; None for the world."""
        sides = self.trees[0][one], self.trees[1][other]
        totals = [sum(self._sizes[side][child] for child in sides[side]) for side in (0, 1)]
        nothing = Alignment(GAP * sum(totals), ())
        if not all(sides):
            return nothing
        # All of one side may stand for what a single limb of the other carries.
        deeper = [self._skip(self.of(child, other), totals[0] - self._sizes[0][child] + 1) for child in sides[0]]
        deeper += [self._skip(self.of(one, child), totals[1] - self._sizes[1][child] + 1) for child in sides[1]]
        return min([self._assigned(sides, nothing.cost), *deeper, nothing], key=_cost)

    def _skip(self, alignment: Alignment, count: int) -> Alignment:
        """Leave out so many joints more, one of which carries what is aligned."""
        return Alignment(alignment.cost + GAP * count + BETWEEN, alignment.pairs)

    def _assigned(self, sides: tuple[tuple[str, ...], tuple[str, ...]], cost: float) -> Alignment:
        """Assign limbs to limbs, each to one at most."""
        found = [[self.limb(one, other) for other in sides[1]] for one in sides[0]]
        gains = np.array(
            [
                [
                    GAP * (self._sizes[0][one] + self._sizes[1][other]) - limb.cost
                    for other, limb in zip(sides[1], row, strict=True)
                ]
                for one, row in zip(sides[0], found, strict=True)
            ]
        )
        rows, columns = linear_sum_assignment(gains, maximize=True)
        pairs = tuple(pair for i, j in zip(rows, columns, strict=True) for pair in found[i][j].pairs)
        return Alignment(cost - float(gains[rows, columns].sum()), pairs)


def distance(source: IOSpec, target: IOSpec) -> float:
    """How far apart two mechanisms are: the cost of their alignment over that of leaving out every joint; 0 if they are one."""
    return align(source, target).cost / (GAP * max(1, len(source.joints) + len(target.joints)))


def balanced(joints: Sequence[Joint]) -> list[Joint]:
    """Shorten the direction in which a load rests that is all but balanced on its joint: a little more on one side turns it."""
    roots, anchors = _roots(joints), {joint.name: joint.anchor or (0.0, 0.0, 0.0) for joint in joints}
    sizes = dict.fromkeys(roots.values(), 0.0)
    for joint in joints:
        root = roots[joint.name]
        sizes[root] = max(sizes[root], math.dist(anchors[joint.name], anchors[root]) + joint.length)
    return [replace(joint, rest=_shortened(joint, BALANCED * sizes[roots[joint.name]])) for joint in joints]


def _shortened(joint: Joint, least: float) -> tuple[float, float, float]:
    share = min(1.0, joint.length / least) if least else 1.0
    x, y, z = (share * part for part in joint.rest)
    return x, y, z


def hindrance(joint: Joint, others: Iterable[Joint]) -> str | None:
    """Say why none of the other robot's joints can stand for one, or None if one can."""
    for lacking, holds in NEEDED:
        others = [other for other in others if holds(joint, other)]
        if not others:
            return f"no {joint.type} {lacking}".rstrip()
    return None


def difference(one: Feature, other: Feature) -> float:
    """Price the differences between two joints; infinite if neither can stand for the other."""
    if not all(holds(one.joint, other.joint) for _, holds in NEEDED):
        return math.inf
    apart = {
        "rest": _rest(one.joint, other.joint),
        "length": _ratio(one.length, other.length),
        "mass": _ratio(one.mass, other.mass),
        "range": _ratio(_width(one.joint), _width(other.joint)),
        "driven": float((one.torque > 0) != (other.torque > 0)),
        "strength": _ratio(one.torque, other.torque),
        "place": abs(one.place - other.place),
        "side": float(any(own * another < 0 for own, another in zip(one.side, other.side, strict=True))),
        "name": float(one.joint.model_name != other.joint.model_name),
        "order": abs(one.order - other.order),
    }
    return sum(WEIGHTS[name] * value for name, value in apart.items())


def _rest(one: Joint, other: Joint) -> float:
    """How differently two loads rest, as one minus the cosine; what is balanced on its joint is at a right angle to others."""
    largest = max(float(np.dot(joint.rest, joint.rest)) for joint in (one, other))
    return largest - float(np.dot(one.rest, other.rest))


NEEDED: Sequence[tuple[str, Callable[[Joint, Joint], bool]]] = (
    ("", lambda one, other: one.type == other.type),
    ("on a parallel axis", parallel),
    ("whose load rests on the same side", lambda one, other: _rest(one, other) <= FARTHEST),
)
"""What a joint must share with another to stand for it, in the words in which the lack of it is said."""


def _ratio(one: float, other: float) -> float:
    """The size of the logarithm of a ratio; nothing of what is not there, or not known."""
    return min(LARGEST, abs(math.log(one / other))) if one > 0 and other > 0 else 0.0


def _width(joint: Joint) -> float:
    if joint.range is None:
        return 2 * math.pi if joint.type == "hinge" else 0.0
    return joint.range[1] - joint.range[0]


def _features(spec: IOSpec, tree: Tree, *, metric: bool) -> dict[str, Feature]:
    torques = dict.fromkeys((joint.name for joint in spec.joints), 0.0)
    for actuator in spec.action:
        if actuator.joint is not None:
            torques[actuator.joint] += abs(actuator.gear) * actuator.half_range
    places = _places(spec, tree, metric=metric)
    lengths = _shares({joint.name: joint.length for joint in spec.joints})
    masses, strengths = _shares({joint.name: joint.mass for joint in spec.joints}), _shares(torques)
    sides, joints = _sides(spec.joints, _roots(spec.joints), torques), balanced(spec.joints)
    found = {}
    for k, joint in enumerate(joints):
        name, order = joint.name, k / len(spec.joints)
        found[name] = Feature(joint, lengths[name], masses[name], strengths[name], places[name], sides[name], order)
    return found


def _shares(values: Mapping[str, float]) -> dict[str, float]:
    largest = max(values.values(), default=0.0)
    return {name: value / largest if largest > 0 else 0.0 for name, value in values.items()}


def _sides(joints: Sequence[Joint], roots: Mapping[str, str], torques: Mapping[str, float]) -> dict[str, tuple[float, float]]:
    """Where each joint is from the middle of the first joints of what is driven, forwards and to the left."""
    anchors = {joint.name: joint.anchor for joint in joints if joint.anchor is not None}
    driven = {roots[name] for name, torque in torques.items() if torque} or {*roots.values()}
    if len(anchors) < len(joints) or not joints:
        return {joint.name: (0.0, 0.0) for joint in joints}
    away = np.array([anchors[joint.name] for joint in joints]) - np.mean([anchors[root] for root in driven], axis=0)
    size = max(np.linalg.norm(row) for joint, row in zip(joints, away, strict=True) if roots[joint.name] in driven)
    signs = np.sign(away) * (np.abs(away) > BESIDE * size)
    return {joint.name: (float(row[0]), float(row[1])) for joint, row in zip(joints, signs, strict=True)}


def _roots(joints: Sequence[Joint]) -> dict[str, str]:
    """The first joint of the tree that each hangs in."""
    roots: dict[str, str] = {}
    for joint in joints:
        roots[joint.name] = joint.name if joint.parent is None else roots[joint.parent]
    return roots


def _places(spec: IOSpec, tree: Tree, *, metric: bool) -> dict[str, float]:
    """How far down each joint is on the longest way through it."""
    anchors = {joint.name: joint.anchor for joint in spec.joints}
    places: dict[str, float] = {}

    def step(upper: str | None, lower: str) -> float:
        if upper is None:
            return 0.0
        return math.dist(anchors[upper] or (), anchors[lower] or ()) if metric else 1.0

    def descend(upper: str | None, gone: float) -> float:
        """Return the longest way from a joint down."""
        ways = []
        for name in tree[upper]:
            way = step(upper, name)
            further = descend(name, gone + way)
            places[name] = (gone + way) / (gone + way + further) if gone + way + further else 0.0
            ways.append(way + further)
        return max(ways, default=0.0)

    descend(None, 0.0)
    return places


def _cost(alignment: Alignment) -> float:
    return alignment.cost
