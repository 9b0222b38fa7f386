"""Matches of real robots, and the contract that a spec on itself is the identity."""

from dataclasses import replace

import numpy as np
import pytest

from tests.envs.own import Plain
from transferkit.envs import derive_spec, environment_ids
from transferkit.matching import compiled, coverage, distance, explain, limits, pair, unmatched
from transferkit.matching.align import hindrance
from transferkit.matching.limits import Limit
from transferkit.matching.scales import Strength, factors

ONE, TWO, CARTPOLE = "InvertedPendulum-v5", "InvertedDoublePendulum-v5", "dm_control/cartpole-balance-v0"
HOPPER, WALKER, CHEETAH = "Hopper-v5", "Walker2d-v5", "HalfCheetah-v5"
DM_HOPPER, DM_WALKER, DM_CHEETAH = (f"dm_control/{name}-v0" for name in ("hopper-stand", "walker-walk", "cheetah-run"))


def matched(source, target, **options):
    specs = derive_spec(source), derive_spec(target)
    pairing = pair(*specs, **options)
    return pairing, compiled(pairing, *specs), *specs


def partners(pairing, source, target, copy=0):
    """Model names of what is matched, the target's joint that has the name alone."""
    own, others = ({joint.name: joint.model_name for joint in spec.joints} for spec in (source, target))
    return {own[one]: others[next(iter(reads))] for one, reads in pairing.copies[copy].joints.items()}


@pytest.mark.parametrize("forces", ["auto", "greater"])
@pytest.mark.parametrize("env_id", environment_ids())
def test_a_spec_on_itself_is_the_identity(env_id, forces):
    _, match, spec, _ = matched(env_id, env_id, limbs="all", angles="carried", forces=forces)
    np.testing.assert_array_equal(np.array(match.weight)[:, : spec.obs_dim], np.eye(spec.obs_dim))
    assert not np.any(np.array(match.weight)[:, spec.obs_dim :])
    assert (set(match.form), set(match.bias), match.copies, match.hold) == ({"linear"}, {0.0}, 1, 1)
    np.testing.assert_array_equal(match.action_weight, np.eye(spec.act_dim))


@pytest.mark.parametrize(("source", "target"), [(WALKER, DM_WALKER), (DM_WALKER, WALKER)])
def test_slides_that_commute_match_in_any_order(source, target):
    pairing, match, *specs = matched(source, target)
    assert len(pairing.copies[0].joints) == 9
    assert coverage(match, specs[0]) == (1.0, 1.0)


def test_heights_are_compared_from_the_reference_poses():
    """Walker2d stands at z = 1.25, dm_control's walker has a root at 0 there and observes 1.3."""
    _, match, source, target = matched(WALKER, DM_WALKER)
    k = [e.name for e in source.observation].index("slide_z.position")
    standing = np.zeros(len(match.weight[k]))
    standing[[e.name for e in target.observation].index("slide_z.position")] = 1.3
    assert np.dot(match.weight[k], standing) + match.bias[k] == pytest.approx(1.25)


def test_a_joint_that_the_source_lacks_is_a_gap():
    pairing, _, *specs = matched(HOPPER, DM_HOPPER)
    assert partners(pairing, *specs) == {
        "rootx": "rootx", "rootz": "rootz", "rooty": "rooty", "thigh_joint": "hip", "leg_joint": "knee", "foot_joint": "ankle",
    }  # fmt: skip


def test_a_waist_between_is_part_of_the_angle_below_it():
    carried, own = (matched(HOPPER, DM_HOPPER, angles=angles)[0].copies[0].joints["hinge_y2"] for angles in ("carried", "own"))
    assert own == {"hinge_y3": -1.0}  # the axes are opposite
    assert carried == {"hinge_y3": -1.0, "hinge_y2": -1.0}


def test_what_two_poles_carry_together_leans_by_a_quarter_of_the_upper_angle():
    """Poles of 0.6 m and one mass: the upper one carries half of it, 0.3 m from its hinge, and the arm is 0.6 m."""
    assert matched(ONE, TWO, angles="carried")[0].copies[0].joints["hinge_y"] == pytest.approx({"hinge_y": 1, "hinge_y2": 0.25})


def test_one_leg_drives_two_by_two_copies_that_see_a_leg_each():
    pairing, match, *specs = matched(HOPPER, WALKER, limbs="all", stagger=0.4)
    assert [partners(pairing, *specs, copy)["leg_joint"] for copy in (0, 1)] == ["leg_joint", "leg_left_joint"]
    assert [copy.shift for copy in pairing.copies] == [{"hinge_y2": -0.2}, {"hinge_y2": 0.2}]
    driven = np.array(match.action_weight) != 0
    np.testing.assert_array_equal(driven, np.eye(6, dtype=bool))
    assert matched(HOPPER, WALKER, limbs="one")[1].copies == 1


def test_two_legs_share_one_which_does_what_both_did():
    pairing, match, *specs = matched(WALKER, HOPPER)
    assert partners(pairing, *specs)["thigh_joint"] == partners(pairing, *specs)["thigh_left_joint"] == "thigh_joint"
    left, right = np.array(match.action_weight)[:, :3], np.array(match.action_weight)[:, 3:]
    np.testing.assert_array_equal(left, right)
    weights = [sum(j.mass for j in spec.joints if j.parent is None) for spec in specs]
    assert left[0, 0] == pytest.approx(100 / 200 * weights[1] / weights[0])
    assert coverage(match, specs[0]) == (1.0, 1.0)


def test_what_stands_keeps_its_torque_for_weight_and_length_and_what_swings_its_acceleration():
    source, target = derive_spec(HOPPER), derive_spec(WALKER)
    pairing = pair(source, target)
    weights = [sum(j.mass for j in spec.joints if j.parent is None) for spec in (source, target)]
    assert pairing.forces == "load"
    assert pairing.length == pytest.approx(1.0)  # thigh and leg are 0.45 m and 0.5 m in both
    assert pairing.copies[0].actions["drive.hinge_y2"]["drive.hinge_y2"] == pytest.approx(
        200 / 100 * weights[1] / weights[0] / 2
    )
    assert pair(source, target, forces="acceleration").copies[0].actions["drive.hinge_y2"]["drive.hinge_y2"] < 0.2  # armature
    assert matched(ONE, CARTPOLE)[0].forces == "acceleration"


def test_a_lighter_robot_keeps_what_its_acceleration_takes_and_a_heavier_one_its_load():
    def shares(env_id, forces):
        (copy,) = pair(derive_spec(HOPPER), derive_spec(env_id), forces=forces).copies
        return [share for factors in copy.actions.values() for share in factors.values()]

    light, heavy = f"{HOPPER}?vary.mass=0.5", f"{HOPPER}?vary.mass=2"
    assert shares(light, "load") == pytest.approx([0.5] * 3)
    assert shares(light, "greater") == shares(light, "acceleration")
    assert all(0.5 < share < 1 for share in shares(light, "greater"))  # the armatures stay
    assert shares(heavy, "greater") == shares(heavy, "load") == pytest.approx([2.0] * 3)


def test_the_greater_of_both_is_no_more_than_the_force_itself():
    own = Strength(acceleration=-6, load=3, force=10)
    assert factors("acceleration", own, [Strength(2, 12, 20)]) == [-3]
    assert factors("load", own, [Strength(2, -12, -20)]) == [-0.25]
    assert factors("greater", own, [Strength(2, -12, -20)]) == [-0.5]  # 10 of 20, as 3 would be more than that
    assert factors("greater", own, [Strength(20, 12, 20)]) == [pytest.approx(0.3)]
    assert factors("greater", own, [Strength(20, 4, 20)]) == [0.75]
    assert factors("greater", own, [Strength(10, 6, 10), Strength(10, -6, 10)]) == [0.3, -0.3]
    assert factors("greater", own, [Strength(0, 0, 0)]) == [1.0]


def test_an_action_lasts_as_long_as_one_of_the_source():
    assert matched(CHEETAH, DM_CHEETAH)[0].hold == 5  # 0.05 s in steps of 0.01 s
    assert matched(DM_CHEETAH, CHEETAH)[0].hold == 1


def test_the_way_back_turns_an_angle_into_its_sine_and_cosine():
    pairing, match, *_ = matched(CARTPOLE, ONE)
    assert match.form == ("linear", "cos", "sin", "linear", "linear")
    assert pairing.length == pytest.approx(5 / 3, rel=1e-4)


def test_hanging_is_not_upright():
    """Pendulums only match where the load rests on the same side of the hinge."""
    source = derive_spec(ONE)
    hanging = [joint if joint.type == "slide" else replace(joint, rest=(0.0, 0.0, -1.0)) for joint in source.joints]
    assert list(pair(source, replace(source, joints=tuple(hanging))).copies[0].joints) == ["slide_x"]


@pytest.mark.parametrize("source", [ONE, "dm_control/pendulum-swingup-v0"])
def test_no_action_of_a_pole_means_anything_on_a_hopper(source):
    assert not matched(source, HOPPER)[1].holds


def test_what_is_not_matched_is_said_with_the_reason():
    _, match, source, target = matched(TWO, ONE)
    text = explain(match, source, target)
    assert "joint hinge_y2 (hinge2) = not matched: nothing like it is left (what could stand for it stands for another)" in text
    assert "core input hinge_y2.velocity = not matched: nothing is matched with hinge_y2" in text
    assert "core input observation[8] = not matched: force, which is the same only in the same mechanism" in text
    text = explain(*matched(HOPPER, WALKER)[1:])
    assert "action drive.hinge_y7 = +1.497 drive.hinge_y4[2]" in text
    left_out = unmatched(*matched(HOPPER, DM_HOPPER)[1:])
    assert [(one.kind, one.name) for one in left_out] == [
        ("target joint", "hinge_y2"),
        ("action", "drive.hinge_y2"),
    ]  # the waist


def test_the_reason_is_the_first_thing_that_no_joint_of_the_other_robot_has():
    slide, hinge = derive_spec(ONE).joints
    assert hindrance(slide, [hinge]) == "no slide"
    assert hindrance(hinge, [slide, replace(hinge, axis=(1.0, 0.0, 0.0))]) == "no hinge on a parallel axis"
    assert hindrance(hinge, [replace(hinge, rest=(0.0, 0.0, -1.0))]) == "no hinge whose load rests on the same side"
    assert hindrance(hinge, [slide, hinge]) is None


def test_what_the_target_can_do_little_of_is_said():
    """The thigh of Walker2d-v5 goes from -150 to 0 degrees, the hip of the suite's walker from -20 to 100: 20 of 150."""
    left, right = (Limit("joint", name, round(20 / 150, 4), 1) for name in ("hinge_y2", "hinge_y5"))
    found = limits(*matched(WALKER, DM_WALKER)[1:])
    assert [one for one in found if one.kind == "joint"] == [left, right]
    _, match, source, target = matched(WALKER, DM_WALKER)
    ankle = match.action_weight[2][2]
    assert Limit("action", "drive.hinge_y4", round(1 / ankle, 4)) in found
    text = explain(match, source, target)
    assert "limited: joint hinge_y2 (thigh_joint) reaches 13% of its range" in text
    assert f"limited: action drive.hinge_y4 has {1 / ankle:.0%} of the force" in text
    assert [one.name for one in limits(*matched(DM_WALKER, WALKER)[1:])] == ["hinge_y2", "hinge_y5"]
    assert {one.kind for one in limits(*matched(HOPPER, WALKER)[1:])} == {"action"}  # the same ranges, a heavier robot


def test_mechanisms_are_as_far_apart_as_their_alignment_costs():
    hopper, walker = derive_spec(HOPPER), derive_spec(WALKER)
    assert distance(hopper, hopper) == pytest.approx(0, abs=1e-6)
    assert distance(hopper, walker) == pytest.approx(distance(walker, hopper))
    assert 0 < distance(hopper, walker) < 0.5
    assert distance(derive_spec("dm_control/pendulum-swingup-v0"), derive_spec("Reacher-v5")) == 1  # one hangs, the others lie


LEG = """<body pos="0 {place} -.2"><joint name="{name}hip" axis="0 1 0" range="-60 60"/>
    <geom type="capsule" fromto="0 0 0 0 0 -.4" size=".05"/></body>"""

BIPED = """<mujoco><worldbody><body pos="0 0 1"><freejoint/><geom type="box" size=".1 .2 .2"/>{}</body></worldbody>
    <actuator><motor joint="{}hip" ctrlrange="-1 1"/><motor joint="{}hip" ctrlrange="-1 1"/></actuator></mujoco>"""


POLE = """<mujoco><worldbody><body><joint name="rail" type="slide" axis="1 0 0"/><geom size=".1"/>
    <body><joint name="pole" axis="0 1 0"/><geom type="capsule" fromto="0 0 0 0 0 {}" size=".05"/></body></body></worldbody>
    <actuator><motor joint="rail" ctrlrange="-1 1"/></actuator></mujoco>"""


def biped(first, second, before="<worldbody>"):
    """Two legs under a box, each with its name and where it is to the left."""
    legs = "".join(LEG.format(name=name, place=place) for name, place in (first, second))
    return derive_spec(Plain(BIPED.replace("<worldbody>", before).format(legs, first[0], second[0])))


def test_left_stands_for_left_whatever_it_is_called():
    source = biped(("left_", 0.1), ("right_", -0.1))
    for target, hip in (
        (biped(("R", -0.1), ("L", 0.1)), "Lhip"),
        (biped(("L", 0.1), ("R", -0.1)), "Lhip"),
        (biped(("a", 0.0), ("b", 0.0)), "ahip"),  # in order, where neither is on a side
        (biped(("right_", 0.1), ("left_", -0.1)), "right_hip"),
        (biped(("left_", 0.0), ("right_", 0.0)), "left_hip"),
    ):
        assert partners(pair(source, target), source, target)["left_hip"] == hip


def test_a_goal_elsewhere_changes_nothing():
    """Sides are those of the robot, and a pole is as upright as without it."""
    goal = '<worldbody><body pos="20 20 0"><joint name="goal" type="slide" axis="1 0 0"/><geom size=".1"/></body>'
    legs = [biped(("left_", 0.1), ("right_", -0.1)), biped(("R", -0.1), ("L", 0.1), goal)]
    assert partners(pair(*legs), *legs)["left_hip"] == "Lhip"
    poles = [derive_spec(Plain(POLE.replace("<worldbody>", goal).format(end))) for end in (0.6, -0.6)]
    assert "pole" not in partners(pair(*poles), *poles)
    assert partners(pair(poles[0], poles[0]), poles[0], poles[0])["pole"] == "pole"


def test_what_has_no_form_is_the_number_with_the_same_values():
    source = derive_spec("Ant-v5")
    target = derive_spec("Ant-v5?vary.permute_observation=[1,2,3,4]")  # the quaternion, from wxyz to xyzw or so
    match = compiled(pair(source, target), source, target)
    assert [row.index(1.0) for row in match.weight[:6]] == [0, 2, 3, 4, 1, 5]
    unnamed = replace(source, observation=tuple(replace(element, values=()) for element in source.observation))
    match = compiled(pair(unnamed, target), unnamed, target)  # as in earlier files, which have no values
    assert [row.index(1.0) for row in match.weight[:6]] == [0, 1, 2, 3, 4, 5]
    longer = derive_spec("Ant-v5?vary.length.front_left_leg=1.2")
    match = compiled(pair(source, longer), source, longer)
    assert [row.index(1.0) for row in match.weight[1:5]] == [1, 2, 3, 4]
