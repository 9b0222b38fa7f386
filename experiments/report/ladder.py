"""The ladder: pairs of a core's own robot and a target, from the same mechanism upwards, and pairs to which nothing crosses."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace

from transferkit.env_id import EnvId

CONTROL = "control"
"""A pair that no map leads across."""

OTHER = "-"
"""A pair that is not on the ladder."""

CHANGED, RESHAPED = "4", "5"
"""The same robot with other numbers, and with other sensors or actuators."""

ORDER = (*"12345678", CONTROL, OTHER)

_SUITE = "dm_control/{}-v0"
_WALKS = tuple(_SUITE.format(task) for task in ("walker-stand", "walker-walk", "walker-run"))
_BALANCE, _SWINGUP, _CHEETAH = (_SUITE.format(task) for task in ("cartpole-balance", "cartpole-swingup", "cheetah-run"))

RUNGS: Mapping[str, tuple[tuple[str, str], ...]] = {
    "1": (("InvertedPendulum-v5", _BALANCE), (_BALANCE, "InvertedPendulum-v5")),
    "2": (("HalfCheetah-v5", _CHEETAH), (_CHEETAH, "HalfCheetah-v5")),
    "3": tuple(pair for walk in _WALKS for pair in (("Walker2d-v5", walk), (walk, "Walker2d-v5"))),
    "6": (*((one, other) for one in _WALKS for other in _WALKS if one != other), (_BALANCE, _SWINGUP)),
    "7": (("Hopper-v5", "Walker2d-v5"), ("HalfCheetah-v5", "Walker2d-v5")),
    "8": (("Hopper-v5", _SUITE.format("hopper-stand")),),
    CONTROL: (
        ("InvertedPendulum-v5", "Hopper-v5"),
        ("InvertedPendulum-v5", "InvertedDoublePendulum-v5"),
        (_SWINGUP, "Hopper-v5"),
    ),
}
"""Source and target of each rung."""


def rung_of(source: str, target: str) -> str:
    """The rung on which a core of a source environment stands on a target."""
    one, other = EnvId.read(source), EnvId.read(target)
    if one.id == other.id and (one.variation or other.variation):
        reshaped = {"drop_observation", "frames", "dead_actuator"} & {*one.variation, *other.variation}
        return RESHAPED if reshaped else CHANGED
    robot = str(replace(one, variation={}))  # that a family is drawn around
    return next((rung for rung, pairs in RUNGS.items() if (robot, target) in pairs), OTHER)
