"""What a target can do little of, by hand."""

import math
from dataclasses import replace

from tests.matching.test_match import HOPPER, ONE, WALKER, matched
from transferkit.envs import derive_spec
from transferkit.matching import compiled, limits, mean_reach, pair, reach
from transferkit.matching.limits import Limit

HINGE = derive_spec(ONE).joints[1]


def test_what_a_hinge_reaches_is_counted_from_its_reference_pose():
    others = {"a": replace(HINGE, range=(-0.5, 1.0), reference=0.25), "b": replace(HINGE, range=(0.0, 0.4), reference=0.0)}
    assert reach({"a": -1.0}, others, 0.1) == (-0.65, 0.85)
    assert reach({"a": 1.0, "b": 0.5}, others) == (-0.75, 0.95)
    others["b"] = replace(HINGE, range=None)
    assert reach({"a": 1.0, "b": 0.5}, others) == (-math.inf, math.inf)


def test_what_has_no_limit_reaches_everything():
    source, target = derive_spec(HOPPER), derive_spec("dm_control/hopper-stand-v0")
    free = replace(target, joints=tuple(replace(joint, range=None) for joint in target.joints))
    match = compiled(pair(source, target), source, target)
    assert mean_reach(match, source, target) < 0.7
    assert mean_reach(match, source, free) == 1
    assert mean_reach(*matched("Reacher-v5", "Reacher-v5")[1:]) == 1
    assert mean_reach(*matched("dm_control/pendulum-swingup-v0", "dm_control/pendulum-swingup-v0")[1:]) is None


def test_a_force_is_counted_from_what_causes_none():
    _, match, source, target = matched(ONE, ONE)
    assert not limits(match, source, target)
    (push,) = target.action

    def limited(low, high, bias):
        bounded = replace(target, action=(replace(push, low=low, high=high),))
        return limits(replace(match, action_bias=(bias,)), source, bounded)

    assert limited(-3.0, 3.0, 1.0) == [Limit("action", push.name, 0.5)]  # from 0 to 2, of which 1 is there
    assert not limits(replace(match, action_weight=((1e-9,),)), source, target)  # next to nothing is asked for
    assert limited(0.0, 6.0, -1.0) == [Limit("action", push.name, 0.0)]  # no force is at -1, below which there is none


def test_each_copy_has_its_hinges_and_an_action_of_the_target_has_none():
    _, match, source, target = matched(HOPPER, WALKER)
    short = replace(target, joints=tuple(replace(joint, range=(-0.1, 0.0)) for joint in target.joints))
    assert {one.copy for one in limits(match, source, short) if one.kind == "joint"} == {1, 2}
    assert {one.copy for one in limits(match, source, target)} == {None}
