"""How joints were matched before policies kept their match: what was trained so must not be wrapped anew.

A source joint matched the first target joint of the same type whose axis is parallel, whose parent is the match of its own
parent, and (for a hinge) whose load rests in the same direction; of several that fit, one of the same name came first.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from transferkit.matching.match import compiled
from transferkit.matching.pair import Driver
from transferkit.matching.scales import length_scale, mass
from transferkit.matching.tree import parallel
from transferkit.pairing import Copy, Pairing

if TYPE_CHECKING:
    from transferkit.matching.match import Match
    from transferkit.spec import IOSpec, Joint

SAME_REST = 0.7
"""Least cosine between the directions in which two hinges carried their load."""


def earlier_match(source: IOSpec, target: IOSpec) -> Match:
    """Match as version 0.1 did."""
    pairs: dict[str, str] = {}
    signs: dict[str, float] = {}
    for joint in source.joints:
        parent = None if joint.parent is None else pairs.get(joint.parent, "")
        taken = set(pairs.values())
        fitting = [one for one in target.joints if one.parent == parent and one.name not in taken and _fits(joint, one)]
        if fitting:
            partner = min(fitting, key=lambda one, name=joint.model_name: one.model_name != name)
            pairs[joint.name], signs[joint.name] = partner.name, float(np.sign(np.dot(joint.axis, partner.axis)))
    scale = length_scale(source, target, pairs, limbs=False)
    actions = Driver(source, target, scale, "acceleration", weighs=mass(source)).actions(pairs, dict.fromkeys(pairs, 1))
    copy = Copy({name: {partner: signs[name]} for name, partner in pairs.items()}, actions)
    return compiled(Pairing(source.env_id, target.env_id, (copy,), scale), source, target)


def _fits(joint: Joint, candidate: Joint) -> bool:
    alike = candidate.type == joint.type and parallel(joint, candidate)
    return alike and (joint.type == "slide" or _rest_alike(joint, candidate))


def _rest_alike(joint: Joint, candidate: Joint) -> bool:
    if not any(joint.rest) or not any(candidate.rest):
        return not any(joint.rest) and not any(candidate.rest)
    return float(np.dot(joint.rest, candidate.rest)) >= SAME_REST
