"""How much longer, stronger and slower: the factors between two matched robots. Nothing of it is fitted.

Motion is scaled by dynamic similarity (Froude): a mechanism `s` times as long under `g` times the gravity moves alike when its
lengths scale with s, times with sqrt(s / g) and accelerations with g. What swings freely keeps the acceleration that an action
causes, with the length from its hinges to the load. What stands on its limbs keeps its torque for its weight and length, with
the length of its limbs: the acceleration of a free limb says nothing of one that carries the robot. A lighter robot needs more
than that, since friction, springs and rotors stay: no less than the acceleration takes, and no more than the source's torque.

An action of what stands is held for as long as its core's own lasts, since a gait has a pace. What swings is balanced by
feedback, the better the faster it comes: the pendulum's core keeps 998 of 1000 on the cart-pole in its steps of 0.01 s, and 876
if its actions last 0.05 s (means of 5 members, 5 episodes).
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import TYPE_CHECKING, NamedTuple

import numpy as np

if TYPE_CHECKING:
    from transferkit.pairing import Forces, Kept
    from transferkit.spec import Actuator, IOSpec

UPRIGHT = 0.99
"""Least cosine between a slide and gravity of a robot that can fall."""


def stands(spec: IOSpec) -> bool:
    """Whether a robot carries its weight by its limbs: it can fall, and nothing drives it along gravity."""
    driven = {actuator.joint for actuator in spec.action}
    falls = [joint for joint in spec.joints if joint.type == "slide" and abs(joint.axis[2]) >= UPRIGHT]
    return any(joint.name not in driven and joint.mass > 0 for joint in falls)


def kept(forces: Forces, source: IOSpec, target: IOSpec) -> Kept:
    """What the actions keep."""
    carries = forces == "load" or (forces in ("auto", "greater") and stands(source) and stands(target))
    if not carries or not mass(source) or not mass(target):
        return "acceleration"
    return "greater" if forces == "greater" else "load"


def length_scale(source: IOSpec, target: IOSpec, pairs: dict[str, str], *, limbs: bool) -> float:
    """Take the geometric mean over the matched hinges: of the ways between them for limbs, else to what they carry."""
    ratios = _link_ratios(source, target, pairs) if limbs else []
    ratios = ratios or _load_ratios(source, target, pairs)
    return float(np.exp(np.mean(np.log(ratios)))) if ratios else 1.0


def _load_ratios(source: IOSpec, target: IOSpec, pairs: dict[str, str]) -> list[float]:
    lengths = {joint.name: joint.length for joint in target.joints}
    both = [(joint.length, lengths[pairs[joint.name]]) for joint in source.joints if joint.name in pairs]
    return [own / other for own, other in both if own > 0 and other > 0]


def _link_ratios(source: IOSpec, target: IOSpec, pairs: dict[str, str]) -> list[float]:
    """Compare the ways from each matched hinge up to the next one that is matched."""
    joints, anchors = {j.name: j for j in source.joints}, {j.name: j.anchor for j in target.joints}
    ratios = []
    for joint in source.joints:
        upper = joint.parent
        while upper is not None and upper not in pairs:
            upper = joints[upper].parent
        if joint.name not in pairs or upper is None or not joint.type == joints[upper].type == "hinge":
            continue
        ways = [_way(joint.anchor, joints[upper].anchor), _way(anchors[pairs[joint.name]], anchors[pairs[upper]])]
        if min(ways) > 1e-3:
            ratios.append(ways[0] / ways[1])
    return ratios


def _way(one: Sequence[float] | None, other: Sequence[float] | None) -> float:
    return 0.0 if one is None or other is None else math.dist(one, other)


def gravity_scale(source: IOSpec, target: IOSpec) -> float:
    """The source's gravity over the target's; 1 if nothing falls in one of them."""
    return source.gravity / target.gravity if source.gravity and target.gravity else 1.0


def similarity(quantity: str, joint_type: str, scale: float, gravity: float) -> float:
    """Divide the source's value by the target's in similar motion, if lengths and gravities have these ratios."""
    length, time = (scale if joint_type == "slide" else 1.0), (scale / gravity) ** 0.5
    return length / time if quantity == "velocity" else length


def hold_steps(source: IOSpec, target: IOSpec, scale: float, *, paced: bool) -> int:
    """Control steps of the target for which an action is held: as long as the source's lasts, in similar motion.

    It is one step where neither a gait has a pace to keep nor the source's policy holds its own actions.
    """
    return max(1, round(source.hold * steps_of(source, target, scale))) if paced or source.hold > 1 else 1


def steps_of(source: IOSpec, target: IOSpec, scale: float) -> float:
    """Control steps of the target that a step of the source is in similar motion; 1 if their lengths are not known."""
    if not source.time_step or not target.time_step:
        return 1.0
    return source.time_step / (scale / gravity_scale(source, target)) ** 0.5 / target.time_step


class Strength(NamedTuple):
    """What an action of 1 does, free of the robot's length and of gravity."""

    acceleration: float
    load: float
    """Force for the robot's weight, 0 if its mass is not known."""
    force: float
    """In newtons, or newton metres."""
    aim: float = 0.0
    """How far an action of 1 leads a position servo, in the robot's lengths; 0 for a motor."""


def strength(actuator: Actuator, length: float, mass: float, gravity: float = 1.0) -> Strength:
    """What an actuator does to a robot of this length and mass, under so many times the gravity."""
    lever = length if actuator.unit == "N m" else 1.0
    force = actuator.gear * actuator.half_range
    load = force / (mass * lever * gravity) if mass else 0.0
    aim = force / actuator.stiffness / (1.0 if actuator.unit == "N m" else length) if actuator.stiffness else 0.0
    return Strength(actuator.authority * lever / gravity, load, force, aim)  # angular accelerations scale with 1 / length


def aims(own: Strength, others: Sequence[Strength]) -> bool:
    """Whether one servo stands for another."""
    return len(others) == 1 and bool(own.aim and others[0].aim)


def factors(keeps: Kept, own: Strength, others: Sequence[Strength]) -> list[float]:
    """Factors from an action of the source to those that do together what it does; 1 where strengths are not known.

    A servo goes to the place that the source's goes to.
    """
    if aims(own, others):
        return [own.aim / others[0].aim]
    of = "acceleration" if keeps == "acceleration" else "load"
    share = _share(of, own, others)
    if not share:
        return [1.0] * len(others)
    if keeps == "greater":
        enough = min(abs(_share("acceleration", own, others)), abs(_share("force", own, others)))
        share = math.copysign(max(abs(share), enough), share)
    return [share * float(np.sign(getattr(other, of))) for other in others]


def _share(of: str, own: Strength, others: Sequence[Strength]) -> float:
    together = sum(abs(getattr(other, of)) for other in others)
    return getattr(own, of) / together if together else 0.0


def mass(spec: IOSpec) -> float:
    """The mass of a whole robot, in kilograms; 0 if it is not known."""
    return sum(joint.mass for joint in spec.joints if joint.parent is None)
