"""What a target cannot do of what a core's robot does: angles that its hinges do not reach, torques that it does not have."""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING, Literal

from transferkit.spec import Feedback

if TYPE_CHECKING:
    from collections.abc import Iterator, Mapping

    from transferkit.matching.match import Match
    from transferkit.pairing import Combination
    from transferkit.spec import Actuator, IOSpec, Joint

EXACT = 1e-6
"""Force, as a share of an actuator's range, that counts as none."""

ENOUGH = 0.7
"""Share from which nothing is said."""


@dataclass(frozen=True)
class Limit:
    """Of what a hinge of the core's robot, or an action of the target, is matched with, only a share can be done."""

    kind: Literal["joint", "action", "aim"]
    """An aim is where a servo goes."""
    name: str
    share: float
    """Of the hinge's range what the target's reach; of the largest force that is asked for what the actuator has."""
    copy: int | None = None
    """From 1: the copy of the core whose joint it is."""


def limits(match: Match, source: IOSpec, target: IOSpec) -> list[Limit]:
    """List what the target can do little of."""
    found = [*_hinges(match, source, target)]
    biases = match.action_bias or (0.0,) * target.act_dim
    left = [max(actuator.left) for actuator in source.action] * match.copies
    for actuator, row, bias in zip(target.action, match.action_weight, biases, strict=True):
        asking = [source.action[k % source.act_dim] for k, weight in enumerate(row) if weight]
        if actuator.joint is not None and any(one.gear for one in asking) and not actuator.gear:
            found.append(Limit("action", actuator.name, 0.0))
        else:
            aims = bool(actuator.stiffness) and all(one.stiffness for one in asking)
            size = sum(abs(weight) * (1.0 if aims else share) for weight, share in zip(row, left, strict=True))
            asked = replace(actuator, forces=None) if aims else actuator
            found.append(Limit("aim" if aims else "action", actuator.name, round(_possible(asked, size, bias), 4)))
    return [limit for limit in found if limit.share < ENOUGH]


@dataclass(frozen=True)
class Unlike:
    """An action of the target whose force depends on something else than the force of what it is matched with."""

    name: str
    feedback: Feedback
    wanted: Feedback
    """What the core's depends on."""


def unlike(match: Match, source: IOSpec, target: IOSpec) -> list[Unlike]:
    """List the actions that push where the core's hold, or the other way round."""
    found: dict[tuple[str, Feedback], Unlike] = {}
    for actuator, row in zip(target.action, match.action_weight, strict=True):
        for k in (k for k, weight in enumerate(row) if weight):
            other = source.action[k % source.act_dim].feedback
            if actuator.feedback is not None and other is not None and other != actuator.feedback:
                found[actuator.name, other] = Unlike(actuator.name, actuator.feedback, other)
    return [*found.values()]


def mean_reach(match: Match, source: IOSpec, target: IOSpec) -> float | None:
    """The mean share of the ranges of the core's hinges that the target's reach; None if none are limited or matched."""
    shares = [one.share for one in _hinges(match, source, target)]
    return sum(shares) / len(shares) if shares else None


def _hinges(match: Match, source: IOSpec, target: IOSpec) -> Iterator[Limit]:
    """Every hinge that is limited and matched, in each copy of the core."""
    others = {joint.name: joint for joint in target.joints}
    for k, copy in enumerate(() if match.pairing is None else match.pairing.copies):
        for joint in source.joints:
            own, reads = _way(joint), copy.joints.get(joint.name)
            if joint.type != "hinge" or own is None or not reads:
                continue
            low, high = reach(reads, others, copy.shift.get(joint.name, 0.0))
            common = max(0.0, min(high, own[1]) - max(low, own[0]))
            yield Limit("joint", joint.name, round(common / (own[1] - own[0]), 4), k + 1)


def _possible(actuator: Actuator, size: float, bias: float) -> float:
    """The share of the force that is asked for, up or down, which an actuator has: the lesser of the two.

    Asked for is an action from `bias - size` to `bias + size`; forces count from what causes none.
    """
    if not actuator.half_range or not size:
        return 1.0
    still, left = actuator.still, actuator.left
    ends = ((1 + still) * left[0], still - bias + size), ((1 - still) * left[1], bias + size - still)
    shares = [max(0.0, has) / asked for has, asked in ends if asked > EXACT]
    return min([1.0, *shares])


def reach(reads: Combination, others: Mapping[str, Joint], shift: float = 0.0) -> tuple[float, float]:
    """The angles, from its reference pose, between which a hinge is that reads these; infinite where one has no limit."""
    ways = [(factor, _way(others[name]) or (-math.inf, math.inf)) for name, factor in reads.items() if factor]
    ends = [sorted((factor * way[0], factor * way[1])) for factor, way in ways]
    return sum(end[0] for end in ends) + shift, sum(end[1] for end in ends) + shift


def _way(joint: Joint) -> tuple[float, float] | None:
    """The range of a joint, from its reference pose; None if it is not limited."""
    if joint.range is None or joint.range[0] >= joint.range[1]:
        return None
    return joint.range[0] - joint.reference, joint.range[1] - joint.reference
