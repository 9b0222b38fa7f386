"""From an alignment of joints to a pairing: copies of the core, what each joint of theirs reads, and what their actions drive.

One limb may stand for several: what hangs on the target beside a matched limb, and is like it, is driven by another copy of the
core that sees itself on that limb. Several may share one: a limb of the source that the target lacks reads its neighbour's, and
the target's limb does what both did together. Limbs that carry a robot share its load: each gets its part of the torque.
"""

from __future__ import annotations

from collections import Counter
from typing import TYPE_CHECKING

import numpy as np

from transferkit.matching.align import Aligner
from transferkit.matching.family import family_of
from transferkit.matching.scales import aims, factors, gravity_scale, hold_steps, kept, length_scale, mass, strength
from transferkit.matching.tree import below, parallel
from transferkit.pairing import Copy, Pairing

if TYPE_CHECKING:
    from collections.abc import Iterable, Mapping

    from transferkit.matching.tree import Tree
    from transferkit.pairing import Angles, Combination, Forces, Kept, Limbs
    from transferkit.spec import Actuator, IOSpec, Joint

MOST_COPIES = 8

Pairs = dict[str, str]
"""Target joint of each source joint."""


def pair(
    source: IOSpec,
    target: IOSpec,
    *,
    limbs: Limbs = "all",
    angles: Angles = "own",
    forces: Forces = "auto",
    stagger: float = 0.0,
) -> Pairing:
    """Pair a core's source with a target.

    `stagger` is how far apart, in radians, the copies see the first joints of the limbs that they drive.
    """
    aligner = Aligner(source, target)
    first = dict(aligner.of(None, None).pairs)
    keeps = kept(forces, source, target)
    carries = keeps != "acceleration"
    scale = length_scale(source, target, first, limbs=carries)
    familiar = family_of(source, target).has(1 / scale, mass(target) / mass(source) if mass(source) else 1.0)
    scale = 1.0 if familiar else scale
    every = _copied(aligner, _shared(aligner, first)) if limbs == "all" else [first]
    read = _Reader(source, target, aligner.trees, angles)
    drive = Driver(source, target, scale, keeps, weighs=mass(target if familiar else source))
    copies = []
    for number, pairs in enumerate(every):
        own = {one: other for one, other in pairs.items() if number == 0 or first.get(one) != other}
        apart = stagger * (number / (len(every) - 1) - 0.5) if len(every) > 1 else 0.0
        doubled = {one for one, other in pairs.items() if any(more.get(one) != other for more in every)}
        roots = [one for one in doubled if read.parents[0][one] not in doubled]
        bearing = {one: len({more.get(one) for more in every}) for one in own}
        copies.append(Copy(read.joints(pairs), drive.actions(own, bearing), dict.fromkeys(roots, apart) if apart else {}))
    hold = hold_steps(source, target, scale, paced=carries)
    return Pairing(source.env_id, target.env_id, tuple(copies), scale, hold, keeps)


def _shared(aligner: Aligner, pairs: Pairs) -> Pairs:
    """Let each driven limb of the source that stands for nothing stand for what one beside it stands for."""
    tree, found = aligner.trees[0], dict(pairs)
    for limb, upper in _left_out(tree, pairs):
        beside = {pairs[other]: aligner.limb(limb, pairs[other]) for other in tree[upper] if other in pairs}
        best = min(beside, key=lambda to: beside[to].cost, default=None)
        if best is not None and aligner.drives(0, limb) and aligner.alike(limb, best):
            found |= dict(beside[best].pairs)
    return found


def _copied(aligner: Aligner, pairs: Pairs) -> list[Pairs]:
    """Add a copy for each driven limb of the target that nothing stands for and that is like one beside it."""
    tree, copies, counts = aligner.trees[1], [pairs], Counter[str]()
    for limb, upper in _left_out(tree, pairs.values()):
        beside = {one: aligner.limb(one, limb) for one, other in pairs.items() if other in tree[upper]}
        root = min(beside, key=lambda one: beside[one].cost, default=None)
        if root is None or not aligner.drives(1, limb) or not aligner.alike(root, limb):
            continue
        counts[root] += 1
        if counts[root] >= MOST_COPIES:
            continue
        if counts[root] == len(copies):
            copies.append(dict(pairs))
        for one in below(aligner.trees[0], root):
            copies[counts[root]].pop(one, None)
        copies[counts[root]] |= dict(beside[root].pairs)
    return copies


def _left_out(tree: Tree, matched: Iterable[str]) -> list[tuple[str, str | None]]:
    """List limbs none of whose joints is matched, with what they hang on, which is matched or the world."""
    known: set[str | None] = {None, *matched}
    return [(limb, upper) for upper in tree if upper in known for limb in tree[upper] if known.isdisjoint(below(tree, limb))]


class _Reader:
    """What each matched joint of the source reads of the target."""

    def __init__(self, source: IOSpec, target: IOSpec, trees: tuple[Tree, Tree], angles: Angles) -> None:
        self._source, self._target = ({joint.name: joint for joint in spec.joints} for spec in (source, target))
        self._trees = trees
        self.parents = tuple({child: upper for upper in tree for child in tree[upper]} for tree in trees)
        self._carried = angles == "carried"

    def joints(self, pairs: Pairs) -> dict[str, Combination]:
        """Read the partner of each joint, and what is beside it."""
        return {one: self._reading(one, other, pairs) for one, other in pairs.items()}

    def _reading(self, one: str, other: str, pairs: Pairs) -> Combination:
        sign = float(np.sign(np.dot(self._source[one].axis, self._target[other].axis)))
        beside = self._beside(one, other, pairs) if self._carried and self._source[one].type == "hinge" else {}
        return {other: sign} | {name: sign * share for name, share in beside.items() if share}

    def _beside(self, one: str, other: str, pairs: Pairs) -> Combination:
        """Hinges of the target that no hinge of the source stands for: between this one and the next above, or below it."""
        joint, matched = self._target[other], set(pairs.values())
        found = {name: _along(joint, self._target[name]) for name in self._between(one, other, pairs)}
        if not self._trees[0][one]:
            loose = [name for name in below(self._trees[1], other)[1:] if name not in matched]
            found |= {name: swing(joint, self._target[name]) for name in loose}
        return found

    def _between(self, one: str, other: str, pairs: Pairs) -> list[str]:
        """Joints from this one's partner up to the partner of the next joint above that is matched."""
        upper, way = self.parents[1][other], []
        while upper is not None and upper not in pairs.values():
            way.append(upper)
            upper = self.parents[1][upper]
        above = self.parents[0][one]
        return way if upper is not None and above is not None and pairs.get(above) == upper else []


def _along(joint: Joint, other: Joint) -> float:
    """How much another hinge turns what this one turns: as much, if their axes are parallel."""
    return float(np.sign(np.dot(joint.axis, other.axis))) if other.type == "hinge" and parallel(joint, other) else 0.0


def swing(joint: Joint, other: Joint) -> float:
    """How far the centre of mass of all that a hinge carries swings about it, for each radian of another hinge further down.

    To first order, at the reference pose.
    """
    if other.type != "hinge" or not joint.length or not joint.mass:
        return 0.0
    arm = joint.length * np.array(joint.rest)
    arm -= arm @ np.array(joint.axis) * np.array(joint.axis)
    moves = other.mass / joint.mass * np.cross(other.axis, other.length * np.array(other.rest))
    return float(np.array(joint.axis) @ np.cross(arm, moves) / (arm @ arm)) if arm @ arm > 0 else 0.0


class Driver:
    """What drives each actuator of a target."""

    def __init__(self, source: IOSpec, target: IOSpec, scale: float, keeps: Kept, *, weighs: float) -> None:
        self._source, self._target = source, target
        self._keeps: Kept = keeps
        self._axes = tuple({joint.name: joint.axis for joint in spec.joints} for spec in (source, target))
        self._own = {one.name: strength(one, scale, weighs, gravity_scale(source, target)) for one in source.action}
        self._others = {one.name: strength(one, 1.0, mass(target)) for one in target.action}

    def actions(self, pairs: Pairs, bearing: Mapping[str, int]) -> dict[str, Combination]:
        """Find the factors of the source's actions for each actuator of the target that these pairs drive.

        `bearing` says how many limbs of the target do together what one of the source did.
        """
        found: dict[str, Combination] = {}
        for actuator in self._source.action:
            joint = actuator.joint
            if joint not in pairs:
                continue
            driving = self._driving(actuator, pairs[joint])
            sharing = {one.joint for one in self._source.action if one.joint in pairs and pairs[one.joint] == pairs[joint]}
            sign = float(np.sign(np.dot(self._axes[0][joint], self._axes[1][pairs[joint]])))
            own, others = self._own[actuator.name], [self._others[name] for name in driving]
            sign /= len(sharing) if aims(own, others) or self._keeps == "acceleration" else bearing[joint]
            shares = factors(self._keeps, own, others)
            for name, share in zip(driving, shares, strict=True):
                found.setdefault(name, {})[actuator.name] = sign * share
        return found

    def _driving(self, actuator: Actuator, to: str) -> list[str]:
        """The target's actuators that do what one of the source does; of the same motors on a joint, each its own."""
        own, others = (
            [one.name for one in spec.action if one.joint == joint]
            for spec, joint in ((self._source, actuator.joint), (self._target, to))
        )
        return [actuator.name] if own == others else others
