"""Which joint of a target stands for which of a source.

A source joint matches the first target joint of the same type whose axis is parallel, whose parent is the match of its own
parent, and (for a hinge) whose load rests in the same direction: upright matches upright, never hanging. Of several that fit,
one of the same name in the model comes first. Signs come from the axes.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING

import numpy as np

if TYPE_CHECKING:
    from transferkit.spec import IOSpec, Joint

PARALLEL = 0.99
"""Least cosine between axes that count as the same."""

SAME_REST = 0.7
"""Least cosine between the directions in which two hinges carry their load."""

Joints = dict[str, tuple[str, float]]
"""Target joint and sign of each source joint that is matched."""


def match_joints(source: Sequence[Joint], target: Sequence[Joint]) -> Joints:
    """Match each source joint whose parent is matched."""
    matched: Joints = {}
    taken: set[str] = set()
    for joint in source:
        if joint.parent is not None and joint.parent not in matched:
            continue
        parent = None if joint.parent is None else matched[joint.parent][0]
        fitting = [one for one in target if one.parent == parent and one.name not in taken and _fits(joint, one)]
        if fitting:
            partner = min(fitting, key=lambda one: one.model_name != joint.model_name)  # the first, if none has the name
            matched[joint.name] = partner.name, float(np.sign(np.dot(joint.axis, partner.axis)))
            taken.add(partner.name)
    return matched


def _fits(joint: Joint, candidate: Joint) -> bool:
    parallel = abs(float(np.dot(joint.axis, candidate.axis))) >= PARALLEL
    return candidate.type == joint.type and parallel and (joint.type == "slide" or _rest_alike(joint, candidate))


def _rest_alike(joint: Joint, candidate: Joint) -> bool:
    """Whether the loads rest in the same direction; one that is balanced on its joint has none."""
    if not any(joint.rest) or not any(candidate.rest):
        return not any(joint.rest) and not any(candidate.rest)
    return float(np.dot(joint.rest, candidate.rest)) >= SAME_REST


def same_mechanism(source: IOSpec, target: IOSpec, joints: Joints) -> bool:
    """Whether the target's joints are the source's, one for one and in order; their lengths and loads may differ.

    Of something without joints only its own environment is known to be the same.
    """
    if not source.joints:
        return (source.env_id, source.obs_dim, source.act_dim) == (target.env_id, target.obs_dim, target.act_dim)
    pairs = zip(source.joints, target.joints, strict=False)
    in_order = all(joints.get(own.name) == (other.name, 1.0) for own, other in pairs)
    return in_order and len(source.joints) == len(target.joints) and source.backend == target.backend


def length_scale(source: IOSpec, target: IOSpec, joints: Joints) -> float:
    """Take the geometric mean over the matched hinges."""
    lengths = {joint.name: joint.length for joint in target.joints}
    ratios = [
        joint.length / lengths[joints[joint.name][0]]
        for joint in source.joints
        if joint.name in joints and joint.length > 0 and lengths[joints[joint.name][0]] > 0
    ]
    return float(np.exp(np.mean(np.log(ratios)))) if ratios else 1.0
