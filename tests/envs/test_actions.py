"""What each element of an action does, behind wrappers, servos, clips, noise and filters of the user's own."""

from dataclasses import replace

import gymnasium
import numpy as np
import pytest
from gymnasium.wrappers import ClipAction, RescaleAction, StickyAction, TransformAction

from tests.envs.own import (
    ARM,
    MODELS,
    PENDULUM,
    Adding,
    LowPassAction,
    Mean,
    NoisyAction,
    Plain,
    Pushed,
    Repeat,
    Scaled,
    Servo,
    pendulum,
)
from tests.policy.cores import random_core
from transferkit import derive_spec, evaluate, load_core, make_env, wrap
from transferkit.matching import Limit, Unlike, compiled, explain, limits, pair, unlike


@pytest.mark.parametrize(
    ("wrapped", "factor", "gear"),
    [
        (lambda: RescaleAction(pendulum(), -1, 1), 1.0, 300.0),
        (lambda: Scaled(pendulum(), -0.5), -2.0, -50.0),
        (lambda: Scaled(pendulum(), 1.0, most=0.1), 1.0, 100.0),
        (lambda: Repeat(pendulum()), 1.0, 100.0),
        (lambda: ClipAction(pendulum()), 1.0, 100.0),
        (lambda: StickyAction(pendulum(), 0.25), 1.0, 100.0),
        (lambda: LowPassAction(pendulum()), 1.0, 100.0),
    ],
)
def test_an_action_is_matched_by_what_reaches_the_actuator(wrapped, factor, gear):
    core, env = load_core("inverted-pendulum-v1"), wrapped()
    (actuator,) = derive_spec(env).action
    assert actuator.gear == gear
    policy = wrap(core, wrapped(), tap="action")
    rows = np.random.default_rng(0).normal(size=(8, 4)).astype(np.float32) * 0.1
    np.testing.assert_allclose(policy.act(rows), factor * core.policy().act(rows), rtol=1e-4)


def test_the_pendulum_stands_behind_rescaled_actions():
    env = RescaleAction(gymnasium.make(PENDULUM), -1, 1)
    assert evaluate(wrap(load_core("inverted-pendulum-v1"), env), env, episodes=3).returns == (1000.0,) * 3


def test_two_motors_on_one_joint_share_what_one_did():
    one = derive_spec(Plain(ARM.format('<actuator><motor joint="turn" gear="2" ctrlrange="-1 1"/></actuator>')))
    two = derive_spec(Plain(MODELS["two motors on one joint"]))
    assert [(a.joint, a.gear) for a in two.action] == [("hinge_y", 1.0), ("hinge_y", -3.0)]
    rows = np.random.default_rng(0).normal(size=(4, 4)).astype(np.float32)
    core = random_core(one)
    torque = wrap(core, two, tap="action").act(rows) @ [1.0, -3.0]
    np.testing.assert_allclose(torque, 2 * core.policy().act(rows)[:, 0], rtol=1e-3)


def test_position_and_filtered_actuators_have_the_acceleration_that_they_cause():
    lift, turn = derive_spec(Plain(MODELS["position"])).action
    mass = 1000 * np.pi * (4 / 3 * 0.1**3 + 0.05**2 * 0.5 + 4 / 3 * 0.05**3)
    assert (lift.joint, lift.unit, turn.joint, turn.unit) == ("slide_z", "N", "hinge_y", "N m")
    assert (lift.gear, turn.gear) == (50.0, 2.0)
    np.testing.assert_allclose(lift.authority, 50 / mass, rtol=1e-3)
    (filtered,) = derive_spec(Plain(MODELS["filtered"])).action
    (integrated,) = derive_spec(Plain(MODELS["integrated"])).action
    assert (filtered.gear, integrated.gear) == (7.0, 5.0)  # of an integrator, what a second of it gives


def test_a_force_that_depends_on_the_state_is_no_motors():
    kinds = {name: [one.feedback for one in derive_spec(Plain(model)).action] for name, model in MODELS.items()}
    assert kinds.pop("position") == ["position", "velocity"]
    assert kinds.pop("muscle") == kinds.pop("integrated") == ["position"]
    assert not any("".join(kind) for kind in kinds.values())
    motors, servo = derive_spec(Plain(MODELS["motors"])), derive_spec(Servo(MODELS["motors"]))
    assert [one.feedback for one in servo.action] == ["position", "position"]
    match = compiled(pair(motors, servo), motors, servo)
    assert unlike(match, motors, servo) == [Unlike(one.name, "position", "") for one in servo.action]
    assert (
        "differs: the force of action drive.slide_z depends on the joint's position, too; the core's depends on nothing else"
        in (explain(match, motors, servo))
    )
    assert not unlike(compiled(pair(servo, servo), servo, servo), servo, servo)


TWO_SERVOS = "<actuator>{}{}</actuator>".format(*['<position joint="lift" kp="25" ctrlrange="-1 1"/>'] * 2)


@pytest.mark.parametrize(
    ("wrapped", "rest", "added"),
    [
        (lambda: RescaleAction(pendulum(), 0, 1), 0.5, ()),
        (lambda: RescaleAction(pendulum(), 2, 6), 4.0, ()),
        (lambda: TransformAction(pendulum(), lambda action: action + 0.6, None), -0.6, (-0.2,)),
        (lambda: TransformAction(pendulum(), lambda action: 0.5 - 2 * action, None), 0.25, (0.25 / 3,)),
        (lambda: TransformAction(pendulum(), lambda action: 3 * np.tanh(action + 0.6), None), -0.6, (-0.2,)),
        (lambda: TransformAction(pendulum(), lambda action: np.clip(action + 3, -3, 3), None), -3.0, (-1.0,)),
        (lambda: RescaleAction(TransformAction(pendulum(), lambda action: np.round(4 * action) / 4, None), 0, 1), 0.5, ()),
        (lambda: RescaleAction(NoisyAction(pendulum()), 0, 1), 0.5, ()),
        (lambda: LowPassAction(pendulum()), 0.0, ()),
        (lambda: StickyAction(pendulum(), 0.25), 0.0, ()),
    ],
)
def test_a_force_is_counted_from_the_action_that_causes_none(wrapped, rest, added):
    core, spec = load_core("inverted-pendulum-v1"), derive_spec(wrapped())
    assert spec.action[0].rest == pytest.approx(rest, rel=1e-3)
    assert compiled(pair(core.spec, spec), core.spec, spec).action_bias == pytest.approx(added, rel=1e-3)
    assert compiled(pair(spec, spec), spec, spec).action_bias == ()
    pushed = derive_spec(Pushed(MODELS["motors"]))
    assert [(one.rest, one.gear) for one in pushed.action] == [(1.0, 3.0), (1.0, 3.0)]


def test_noise_on_actions_is_averaged():
    (noisy,) = derive_spec(NoisyAction(pendulum())).action
    assert (noisy.gear, noisy.feedback) == (pytest.approx(100, rel=0.02), "")


def test_an_action_that_adds_up_is_not_known(caplog):
    assert [one.joint for one in derive_spec(Adding(MODELS["two motors on one joint"])).action] == [None, None]
    assert caplog.messages == ["what some actions of Adding do adds up with those before, and is not known"]


def test_an_actuator_of_an_earlier_file_is_as_its_like():
    now = derive_spec(RescaleAction(pendulum(), 0, 1))
    earlier = replace(now, action=tuple(replace(one, rest=None, feedback=None) for one in now.action))
    assert compiled(pair(earlier, now), earlier, now).action_bias == ()
    servo = derive_spec(Plain(MODELS["position"]))
    earlier = replace(servo, action=tuple(replace(one, feedback=None) for one in servo.action))
    assert not unlike(compiled(pair(earlier, servo), earlier, servo), earlier, servo)


def test_servos_go_to_the_same_place():
    arm = '<actuator><position joint="lift" kp="{}" ctrlrange="{}"/></actuator>'
    source, stiffer, wider = (
        derive_spec(Plain(ARM.format(arm.format(*one)))) for one in ((50, "-1 1"), (200, "-1 1"), (50, "0 4"))
    )
    assert (source.action[0].stiffness, stiffer.action[0].stiffness) == (50, 200)
    assert compiled(pair(source, stiffer), source, stiffer).action_weight == ((1.0,),)
    match = compiled(pair(source, wider), source, wider)
    assert (match.action_weight, match.action_bias) == (((0.5,),), (-1.0,))  # 1 m is half of 2, and 0 m the low end
    assert limits(match, source, wider) == [Limit("aim", "drive.slide_z", 0.0)]  # it does not go down
    clipped, two = (derive_spec(Plain(ARM.format(one))) for one in (arm.format(9000, '-1 1" forcerange="-50 50'), TWO_SERVOS))
    match = compiled(pair(source, clipped), source, clipped)
    assert (match.action_weight, limits(match, source, clipped)) == (((1.0,),), [])
    match = compiled(pair(source, two), source, two)
    np.testing.assert_allclose(match.action_weight, [[1.0], [1.0]], rtol=1e-3)


def test_what_settles_slowly_neither_lasts_nor_is_noise():
    for kind in (lambda: make_env(f"{PENDULUM}?vary.delay=30"), lambda: Mean(pendulum(), 8)):
        (slow,) = derive_spec(kind()).action
        assert (slow.gear, slow.rest, slow.forces) == (100.0, 0.0, None)


def test_what_a_clip_leaves_of_a_force_is_known():
    core, clipped = load_core("inverted-pendulum-v1"), derive_spec(Scaled(pendulum(), 1.0, most=0.3))
    assert clipped.action[0].forces == (-30.0, 30.0)
    matched = (compiled(pair(core.spec, clipped), core.spec, clipped), core.spec, clipped)
    assert limits(*matched) == [Limit("action", "drive.slide_x", 0.1)]
    assert not limits(compiled(pair(clipped, clipped), clipped, clipped), clipped, clipped)
    assert not limits(compiled(pair(clipped, core.spec), clipped, core.spec), clipped, core.spec)
    joint = ARM.replace('axis="0 1 0"', 'axis="0 1 0" actuatorfrcrange="-1 4"')
    (turn,) = derive_spec(Plain(joint.format('<actuator><motor joint="turn" gear="8" ctrlrange="-1 1"/></actuator>'))).action
    assert (turn.gear, turn.forces, turn.left) == (8.0, (-1.0, 4.0), (0.125, 0.5))
    dead = derive_spec(f"{PENDULUM}?vary.dead_actuator=[0]")
    assert limits(compiled(pair(core.spec, dead), core.spec, dead), core.spec, dead) == [Limit("action", "drive.slide_x", 0.0)]
    (turn,) = derive_spec(Plain(joint.format('<actuator><motor joint="turn" gear="8" ctrlrange="0 1"/></actuator>'))).action
    assert (turn.rest, turn.left) == (0.0, (1.0, 0.5))
