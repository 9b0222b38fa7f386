"""What a target cannot do of what a core's robot does: angles that its joints do not reach, torques that it does not have."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING, Literal

if TYPE_CHECKING:
    from collections.abc import Iterator, Mapping

    from transferkit.matching.match import Match
    from transferkit.pairing import Combination
    from transferkit.spec import IOSpec, Joint

ENOUGH = 0.7
"""Share from which nothing is said."""


@dataclass(frozen=True)
class Limit:
    """Of what a joint of the core's robot, or an action of the target, is matched with, only a share can be done."""

    kind: Literal["joint", "action"]
    name: str
    share: float
    """Of the joint's range what the target's joints reach; of the largest force that is asked for what the actuator has."""
    copy: int = 1
    """From 1: the copy of the core whose joint it is."""


def limits(match: Match, source: IOSpec, target: IOSpec) -> list[Limit]:
    """List what the target can do little of."""
    found = [*_joints(match, source, target)]
    for actuator, row in zip(target.action, match.action_weight, strict=True):
        found.append(Limit("action", actuator.name, round(1 / max(1.0, sum(map(abs, row))), 4)))
    return [limit for limit in found if limit.share < ENOUGH]


def mean_reach(match: Match, source: IOSpec, target: IOSpec) -> float:
    """The mean share of the ranges of the core's hinges that the target's reach; 1 if none are limited."""
    shares = [one.share for one in _joints(match, source, target)]
    return sum(shares) / len(shares) if shares else 1.0


def _joints(match: Match, source: IOSpec, target: IOSpec) -> Iterator[Limit]:
    """Every hinge that is matched with what is limited as it is itself, in each copy of the core."""
    others = {joint.name: joint for joint in target.joints}
    for k, copy in enumerate(() if match.pairing is None else match.pairing.copies):
        for joint in source.joints:
            own, ways = _way(joint), reach(joint, copy.joints.get(joint.name, {}), others, copy.shift.get(joint.name, 0.0))
            if own is not None and ways is not None:
                common = max(0.0, min(ways[1], own[1]) - max(ways[0], own[0]))
                yield Limit("joint", joint.name, round(common / (own[1] - own[0]), 4), k + 1)


def reach(joint: Joint, reads: Combination, others: Mapping[str, Joint], shift: float = 0.0) -> tuple[float, float] | None:
    """The angles, from a hinge's reference pose, that what it reads can take; None if either is not limited."""
    ways = [(factor, way) for name, factor in reads.items() if (way := _way(others[name]))]
    if joint.type != "hinge" or _way(joint) is None or not ways or len(ways) < len(reads):
        return None
    ends = [sorted((factor * way[0], factor * way[1])) for factor, way in ways]
    return sum(end[0] for end in ends) + shift, sum(end[1] for end in ends) + shift


def _way(joint: Joint) -> tuple[float, float] | None:
    """The range of a joint, from its reference pose; None if it is not limited."""
    if joint.range is None or joint.range[0] >= joint.range[1]:
        return None
    return joint.range[0] - joint.reference, joint.range[1] - joint.reference
