"""A changed robot is what somebody would have changed by hand, to the bit."""

import copy
from pathlib import Path

import gymnasium
import mujoco
import numpy as np
import pytest
from gymnasium.spaces import Box
from gymnasium.wrappers import TransformObservation

from envs_dmc.suite import suite
from tests.envs.own import MODELS, Plain, PreviousAction
from transferkit import derive_spec, make_env, match, vary
from transferkit.envs import VectorEnv, recorded
from transferkit.envs.model_edits import edited
from transferkit.errors import ConfigError, EnvironmentContractError, UnknownNameError
from transferkit.variation import Variation

HOPPER = "Hopper-v5"
LOADED = {name: getattr(mujoco.MjModel, name) for name in ("from_xml_path", "from_xml_string")}

BY_HAND = [
    ({"mass": 1.3}, [('condim="1" contype="1"', 'condim="1" contype="1" density="1300"')]),
    ({"mass": {"thigh": 1.3}}, [('name="thigh_geom"', 'name="thigh_geom" density="1300"')]),
    ({"gear": 0.5}, [('gear="200.0"', 'gear="100.0"')]),
    ({"gear": {"leg_joint": 0.5}}, [('gear="200.0" joint="leg_joint"', 'gear="100.0" joint="leg_joint"')]),
    ({"damping": {"foot_joint": 2}}, [('name="foot_joint"', 'name="foot_joint" damping="2"')]),
    ({"friction": {"foot_geom": 0.5}}, [('friction="2.0"', 'friction="1.0"')]),
    ({"gravity": 0.5}, [('timestep="0.002"', 'timestep="0.002" gravity="0 0 -4.905"')]),
    (
        {"length": {"thigh": 0.5}},
        [
            ('pos="0 0 -0.22500000000000009" name="thigh_geom" size="0.05 0.22500000000000003"',
             'pos="0 0 -0.11250000000000004" name="thigh_geom" size="0.05 0.11250000000000002"'),
            ('name="leg" pos="0 0 -0.70000000000000007"', 'name="leg" pos="0 0 -0.47500000000000003"'),
        ],
    ),
    ({"dead_actuator": [1]}, [('gear="200.0" joint="leg_joint"', 'gear="0" joint="leg_joint"')]),
]  # fmt: skip


def played(env, seed=0, steps=100):
    rows = [env.reset(seed=seed)[0]]
    actions = np.random.default_rng(0).uniform(-1, 1, (steps, *env.action_space.shape))
    return np.array(rows + [env.step(action)[0] for action in actions])


@pytest.mark.parametrize(("changes", "replacements"), BY_HAND, ids=[str(changes) for changes, _ in BY_HAND])
def test_the_physics_is_that_of_an_xml_changed_by_hand(changes, replacements, tmp_path):
    text = Path(gymnasium.make(HOPPER).unwrapped.fullpath).read_text()
    for old, new in replacements:
        assert old in text
        text = text.replace(old, new)
    (tmp_path / "hand.xml").write_text(text)
    by_hand = played(gymnasium.make(HOPPER, xml_file=str(tmp_path / "hand.xml")))
    for env in (
        vary(HOPPER, **changes),
        vary(gymnasium.make(HOPPER), **changes),
        vary(lambda: gymnasium.make(HOPPER), **changes),
    ):
        np.testing.assert_allclose(played(env), by_hand, rtol=0, atol=1e-12)
    assert not np.array_equal(by_hand, played(gymnasium.make(HOPPER)))
    assert {name: getattr(mujoco.MjModel, name) for name in LOADED} == LOADED  # nothing stays patched


def test_both_backends_and_functions():
    heavy, light = (derive_spec(vary("dm_control/cheetah-run-v0", mass=mass)) for mass in (2.0, 1.0))
    assert light.action == derive_spec("dm_control/cheetah-run-v0").action
    for a, b in zip(heavy.action, light.action, strict=True):
        assert abs(a.authority) < abs(b.authority)
    assert vary(lambda: suite.load("cheetah", "run"), mass=2.0).reset(seed=0)
    arm = vary(lambda: Plain(MODELS["motors"]), mass=2.0)
    assert derive_spec(arm).action[0].authority == pytest.approx(
        derive_spec(Plain(MODELS["motors"])).action[0].authority / 2, rel=1e-3
    )


def test_lengths_of_unnamed_bodies_pairs_and_ball_joints():
    assert derive_spec(vary("Ant-v5", length=1.2)).joints[6].length > derive_spec("Ant-v5").joints[6].length
    pair = "<mujoco><worldbody><body><freejoint/><geom name='a' size='.1'/></body><geom name='b' size='1 1 .1' type='plane'/>"
    pair += "</worldbody><contact><pair geom1='a' geom2='b' friction='.5 .4 .1 .1 .1'/></contact></mujoco>"
    model = edited(mujoco.MjSpec.from_string(pair), {"friction": {"": 2.0}}, [])
    assert model.pair_friction[0].tolist() == [1.0, 0.8, 0.1, 0.1, 0.1]
    ball = "<mujoco><worldbody><body><joint type='ball' pos='0 0 .2'/><geom size='.05 .2' type='capsule'/></body>"
    ball += "</worldbody></mujoco>"
    model = edited(mujoco.MjSpec.from_string(ball), {"length": {"": 2.0}}, [])
    assert model.geom_pos[0].tolist() == [0.0, 0.0, -0.2]  # its upper end stays with the joint
    assert model.geom_size[0, 1] == 0.4


def test_what_the_environment_set_itself_stays():
    def moon():
        env = gymnasium.make(HOPPER)
        env.unwrapped.model.opt.gravity[2] = -1.62
        return env

    np.testing.assert_array_equal(played(vary(moon, mass=1.0)), played(moon()))
    with pytest.raises(ConfigError, match=r"opt\.gravity of the model is changed after it is loaded"):
        vary(moon, gravity=2.0)


def test_a_mean_inertia_of_the_environment_stays_unless_it_is_varied():
    env = gymnasium.make(HOPPER)
    own = env.unwrapped.model.stat.meaninertia
    env.unwrapped.model.stat.meaninertia = 2 * own
    lighter = vary(env, gear=0.5)
    lighter.reset()
    assert env.unwrapped.model.stat.meaninertia == 2 * own
    heavy = vary(gymnasium.make(HOPPER), mass=2.0)
    assert heavy.unwrapped.model.stat.meaninertia > 1.5 * own
    assert vary(heavy, mass=1.0).unwrapped.model.stat.meaninertia == own


def test_more_changes_come_on_top():
    twice = vary(vary(HOPPER, mass=2.0), gear=0.5)
    np.testing.assert_array_equal(played(twice), played(vary(HOPPER, mass=2.0, gear=0.5)))
    assert recorded(twice) == "Hopper-v5?vary.mass=2.0&vary.gear=0.5"


@pytest.mark.parametrize("form", [str, vary])
@pytest.mark.parametrize(
    ("changes", "neutral"),
    [
        ({"delay": 2}, {"delay": 0}),
        ({"frames": 2}, {"frames": 1}),
        ({"control_step": 2}, {"control_step": 1}),
        ({"drop_observation": [1]}, {"drop_observation": []}),
        ({"permute_observation": [1, 3]}, {"permute_observation": ()}),
        ({"dead_actuator": [0]}, {"dead_actuator": []}),
        ({"mass": 1.4, "gravity": 0.8}, {"mass": 1, "gravity": 1}),
        ({"noise": 0.1}, {"noise": 0}),
    ],
)
def test_a_change_is_taken_back_by_the_value_that_changes_nothing(form, changes, neutral):
    changed = vary(HOPPER, **changes)
    back = vary(recorded(changed) if form is str else changed, **neutral)
    np.testing.assert_array_equal(played(back), played(vary(HOPPER)))
    assert recorded(back) == HOPPER


def test_a_change_that_is_refused_leaves_the_others():
    env = vary(HOPPER, mass=1.4, control_step=2)
    first = played(env)
    with pytest.raises(UnknownNameError):
        vary(env, masss=2)
    np.testing.assert_array_equal(played(env), first)
    assert env.unwrapped.frame_skip == 8


def test_a_refused_change_leaves_the_environment():
    env = gymnasium.make(HOPPER)
    with pytest.raises(UnknownNameError, match="unknown element of the observation 'typo'"):
        vary(env, mass=2, noise={"typo": 0.1})
    np.testing.assert_array_equal(played(vary(env, mass=2)), played(vary(HOPPER, mass=2)))
    with pytest.raises(ConfigError, match="if `vary` changed it, vary what that returned"):
        vary(env, mass=3)


def test_an_observation_of_another_shape_is_not_cut():
    def longer():
        return TransformObservation(gymnasium.make(HOPPER), lambda row: np.append(row, 7.0), Box(-np.inf, np.inf, (11,)))

    with pytest.raises(EnvironmentContractError, match=r"returned an observation of shape \(12,\), not \(11,\)"):
        vary(longer, delay=1).reset()


def test_a_part_that_is_as_it_was_stands_over_all():
    given = {"mass": 1.4, "mass.torso": 1.0}
    assert Variation.read(given).written() == given


def test_a_part_in_a_table_is_changed_again():
    again = vary('Hopper-v5?vary.mass={"torso":2,"foot":3}', mass={"torso": 4})
    assert recorded(again) == "Hopper-v5?vary.mass.torso=4.0&vary.mass.foot=3.0"


def test_a_range_is_drawn_from_the_seed_of_each_episode():
    env, other = (vary(HOPPER, mass=(0.7, 1.3), friction=(0.5, 1.5), delay=(0, 3), noise=0.01) for _ in range(2))
    first = played(env, 3)
    played(env, 4)
    np.testing.assert_array_equal(first, played(env, 3))
    np.testing.assert_array_equal(first, played(other, 3))
    np.testing.assert_array_equal(first, played(copy.deepcopy(env), 3))
    env.reset(seed=5)
    masses = [(env.reset(), env.unwrapped.model.body_mass.copy())[1] for _ in range(3)]
    assert len({float(mass[1]) for mass in masses}) == 3
    ratio = masses[0][1:] / mujoco.MjModel.from_xml_path(env.unwrapped.fullpath).body_mass[1:]
    np.testing.assert_allclose(ratio, ratio[0])
    assert 0.7 <= ratio[0] <= 1.3


def test_a_control_step_has_other_physics_steps():
    np.testing.assert_array_equal(played(vary(HOPPER, control_step=0.5)), played(gymnasium.make(HOPPER, frame_skip=2)))
    specs = [derive_spec(env) for env in (HOPPER, f"{HOPPER}?vary.control_step=0.5", f"{HOPPER}?vary.control_step=[0.5,1.5]")]
    assert [spec.time_step for spec in specs] == [0.008, 0.004, 0.008]
    assert specs[0].action == specs[1].action == specs[2].action
    assert derive_spec("dm_control/cheetah-run-v0?vary.control_step=2").time_step == 0.02
    assert match(HOPPER, f"{HOPPER}?vary.control_step=0.5").hold == 2
    on_top = vary(vary(HOPPER, control_step=2), control_step=0.5)
    np.testing.assert_array_equal(played(on_top), played(gymnasium.make(HOPPER, frame_skip=2)))


def test_a_control_step_is_one_of_a_few_in_every_episode():
    env, other = (vary(HOPPER, control_step=(0.5, 1.5)) for _ in range(2))
    drawn = [(env.reset(), env.unwrapped.frame_skip)[1] for _ in range(60)]
    assert set(drawn) == {2, 3, 4, 5, 6}
    np.testing.assert_array_equal(played(env, 3), played(other, 3))
    assert recorded(env) == "Hopper-v5?vary.control_step=[0.5,1.5]"


def test_an_episode_is_restored_to_the_bit():
    make = lambda: make_env(vary(HOPPER, mass=(0.7, 1.3), noise=0.01, delay=1, control_step=(0.5, 1.5)))  # noqa: E731
    envs, twin = (VectorEnv([make()], lambda _, episode: 7 + episode) for _ in range(2))
    envs.reset()
    for _ in range(40):
        envs.step(np.full((1, 3), 0.3, np.float32))
    twin.restore(envs.state())
    action = np.full((1, 3), -0.4, np.float32)
    np.testing.assert_array_equal(envs.step(action).observation, twin.step(action).observation)


def test_what_is_seen_and_done_late():
    env = vary("InvertedPendulum-v5", delay=2, drop_observation=[0, "hinge_y.velocity"], noise={"hinge_y.position": 0.5})
    spec = derive_spec(env)
    assert [element.name for element in spec.observation] == ["hinge_y.position", "slide_x.velocity"]
    assert spec.action == derive_spec("InvertedPendulum-v5").action
    env.reset(seed=0)
    controls = [(env.step(np.array([1.0])), float(env.unwrapped.data.ctrl[0]))[1] for _ in range(3)]
    assert controls == [0.0, 0.0, 1.0]
    plain = vary("InvertedPendulum-v5", drop_observation=[0, 3])
    rows = [(env.reset(seed=k)[0], plain.reset(seed=k)[0]) for k in range(400)]
    difference = np.array([a - b for a, b in rows])
    assert difference[:, 0].std() == pytest.approx(0.5, rel=0.15)
    assert not difference[:, 1].any()


def test_elements_change_places_and_are_known_there():
    plain, env = (
        vary("InvertedPendulum-v5", **changes) for changes in ({}, {"permute_observation": [0, "hinge_y.velocity", 1]})
    )
    (raw, _), (observation, _) = (one.reset(seed=0) for one in (plain, env))
    np.testing.assert_array_equal(observation, raw[[1, 3, 2, 0]])  # 0 stands where 3 stood, 3 where 1 did, 1 where 0 did
    names = [element.name for element in derive_spec(plain).observation]
    assert [element.name for element in derive_spec(env).observation] == [names[i] for i in (1, 3, 2, 0)]
    both = vary("InvertedPendulum-v5", permute_observation=[0, 1], drop_observation=[0])
    np.testing.assert_array_equal(both.reset(seed=0)[0], raw[[1, 2, 3]])


def test_the_latest_observations_are_one():
    env = vary("InvertedPendulum-v5", drop_observation=[2, 3], frames=3, noise={"hinge_y.position": 0.1})
    first = env.reset(seed=0)[0]
    np.testing.assert_array_equal(first, np.tile(first[:2], 3))
    second = env.step(np.array([0.5]))[0]
    third = env.step(np.array([0.5]))[0]
    np.testing.assert_array_equal(third[:4], second[2:])  # the oldest first, and a frame keeps its noise
    assert recorded(env).endswith("vary.noise.hinge_y.position=0.1&vary.frames=3&vary.drop_observation=[2,3]")
    again = [element.age for element in derive_spec("InvertedPendulum-v5?vary.frames=2").observation]
    assert again == [1, 1, 1, 1, 0, 0, 0, 0]


def test_it_is_written_down():
    env = vary("Hopper-v5?frame_skip=8", mass=(0.7, 1.3), length={"thigh": 0.8}, dead_actuator=[0])
    name = "Hopper-v5?frame_skip=8&vary.mass=[0.7,1.3]&vary.length.thigh=0.8&vary.dead_actuator=[0]"
    assert recorded(env) == recorded(make_env(name)) == name
    assert recorded(vary(gymnasium.make("Hopper-v5", frame_skip=8), mass=1.3)) == "Hopper-v5?frame_skip=8&vary.mass=1.3"
    assert recorded(vary(PreviousAction(gymnasium.make(HOPPER)), gravity=0.5)).startswith("<Varied of")
    np.testing.assert_array_equal(played(make_env(name)), played(env).astype(np.float32))
    given = {"mass": [0.7, 1.3], "noise.x": 0.1, "delay": [1, 2], "dead_actuator": ["a", 3]}
    assert Variation.read(given).written() == given


@pytest.mark.parametrize(
    ("env", "changes", "kind", "message"),
    [
        (HOPPER, {"mas": 1}, UnknownNameError, "unknown variation 'mas'; did you mean mass"),
        (HOPPER, {"mass": {"tigh": 1}}, UnknownNameError, "unknown body 'tigh'; did you mean thigh"),
        (HOPPER, {"gear": {"hip": 2}}, UnknownNameError, "unknown actuator 'hip'"),
        (HOPPER, {"mass": 0}, ConfigError, "mass=0 must be a number or a range, low first"),
        (HOPPER, {"mass": (2, 1)}, ConfigError, "mass=.2, 1. must be"),
        (HOPPER, {"mass": "heavy"}, ConfigError, "mass='heavy' must be"),
        (HOPPER, {"mass": float("nan")}, ConfigError, "mass=nan must be"),
        (HOPPER, {"delay": 0.5}, ConfigError, "whole control steps"),
        (HOPPER, {"mass": 10**400}, ConfigError, "mass=1000.* must be a number or a range"),
        (HOPPER, {"delay": 10**9}, ConfigError, "delay=1000000000 must be"),
        (HOPPER, {"gravity": {"z": 1}}, ConfigError, "gravity is one for the whole environment"),
        (HOPPER, {"drop_observation": [11]}, ConfigError, "drop_observation=11 must be 0 to 10"),
        (HOPPER, {"drop_observation": list(range(11))}, ConfigError, "nothing is left to observe"),
        (HOPPER, {"permute_observation": [0, 11]}, ConfigError, "permute_observation=11 must be 0 to 10"),
        (HOPPER, {"permute_observation": [1, 2, 1]}, ConfigError, "permute_observation=.1, 2, 1. must be"),
        (HOPPER, {"frames": 0}, ConfigError, "frames=0 must be a number or a range, low first, 1 to 100"),
        (HOPPER, {"frames": (1, 2)}, ConfigError, "must be one number and no range"),
        (HOPPER, {"frames": 2.5}, ConfigError, "frames=2.5 must be whole numbers"),
        (HOPPER, {"drop_observation": ["x"]}, UnknownNameError, "unknown element of the observation 'x'"),
        (HOPPER, {"dead_actuator": [3]}, ConfigError, "dead_actuator=3 must be 0 to 2"),
        (HOPPER, {"control_step": 0.3}, ConfigError, "control_step=0.3 must be a multiple of 0.25, or a range with one"),
        (HOPPER, {"control_step": (1.1, 1.2)}, ConfigError, "physics steps of a control step: 4"),
        (HOPPER, {"control_step": 0}, ConfigError, "control_step=0 must be a number or a range, low first, 0.001 to 1000"),
        ("CartPole-v1", {"control_step": 2}, ConfigError, "holds no number of physics steps"),
        ("CartPole-v1", {"mass": 1.1}, ConfigError, "is not a MuJoCo environment"),
        ("CartPole-v1", {"delay": 1}, EnvironmentContractError, r"action space of CartPole-v1=Discrete\(2\) must be a flat"),
        ("FrozenLake-v1", {"frames": 2}, EnvironmentContractError, "must be a flat and bounded Box"),
        (HOPPER, {"gear": {0: 0.5}}, UnknownNameError, "unknown actuator '0'; known are actuator0, thigh_joint"),
        (HOPPER, {"noise": {0: 0.5}}, UnknownNameError, "unknown element of the observation '0'"),
        (HOPPER, {"mass": {None: 2}}, UnknownNameError, "unknown body 'None'"),
        (HOPPER, {"mass": {}}, ConfigError, "mass={} must be a value, or a table with one"),
        (HOPPER, {"gear": {"actuator0": 3, "drive.hinge_y2": 0.5}}, ConfigError, "gear has actuator0 under two names"),
        (HOPPER, {"gear": {"actuator0": 3, "thigh_joint": 0.5}}, ConfigError, "gear has actuator0 and thigh_joint, which"),
        ("dm_control/dog-run-v0", {"length": 1.1}, ConfigError, "its inertia is given in numbers"),
    ],
)  # fmt: skip
def test_what_cannot_be_varied_is_one_line(env, changes, kind, message):
    with pytest.raises(kind, match=message) as error:
        vary(env, **changes)
    assert "\n" not in str(error.value)


def test_a_family_is_described_by_the_robot_that_it_is_drawn_around():
    known = derive_spec("Hopper-v5")
    for order in ("vary.gear=[0.5,2]&vary.damping=[0.9,1.1]", "vary.damping=[0.9,1.1]&vary.gear=[0.5,2]"):
        spec = derive_spec(f"Hopper-v5?{order}")
        assert (spec.action, spec.joints, spec.observation) == (known.action, known.joints, known.observation)
    stronger = derive_spec("Hopper-v5?vary.gear=[1.4,1.6]").action
    assert [one.gear for one in stronger] == pytest.approx([1.5 * one.gear for one in known.action])


def test_noise_by_name_stands_over_that_of_all_in_any_order():
    for noise in ({"": 0.01, "slide_x.position": 0.5}, {"slide_x.position": 0.5, "": 0.01}):
        assert vary("InvertedPendulum-v5", noise=noise)._deviation.tolist() == [0.5, 0.01, 0.01, 0.01]


def test_what_is_varied_under_the_contract_stays_under_its_rules():
    limited = vary(make_env("InvertedPendulum-v5", max_episode_steps=50, clip_actions=False), mass=2)
    assert (make_env(limited).max_episode_steps, make_env(limited).clip) == (50, False)
    assert recorded(vary(limited, gear=2)) == "InvertedPendulum-v5?vary.mass=2.0&vary.gear=2.0"


def test_actuators_are_named_as_they_are_shown_though_the_model_has_no_names_for_them():
    for change in ({"dead_actuator": ["drive.hinge_y2"]}, {"gear": {"drive.hinge_y2": 0.5}}):
        gears = [one.gear for one in derive_spec(vary("Hopper-v5", **change)).action]
        known = [one.gear for one in derive_spec("Hopper-v5").action]
        factor = 0.0 if "dead_actuator" in change else 0.5
        assert gears == pytest.approx([known[0] * factor, *known[1:]])
    with pytest.raises(UnknownNameError, match="known are actuator0, thigh_joint"):
        vary("Hopper-v5", gear={"hip": 2.0})


def test_a_family_that_is_made_is_called_by_its_id():
    family = "Hopper-v5?vary.mass=[0.7,1.3]"
    assert derive_spec(vary("Hopper-v5", mass=np.array([0.7, 1.3]))).env_id == derive_spec(family).env_id == family


def test_a_pole_that_gravity_pulls_up_hangs():
    (upright,) = (joint for joint in derive_spec("InvertedPendulum-v5").joints if joint.type == "hinge")
    (hanging,) = (joint for joint in derive_spec("InvertedPendulum-v5?vary.gravity=-1").joints if joint.type == "hinge")
    assert hanging.rest == (upright.rest[0], upright.rest[1], -upright.rest[2])
    assert "hinge_y" not in match("InvertedPendulum-v5", "InvertedPendulum-v5?vary.gravity=-1").copies[0].joints


def test_numbers_of_numpy_are_numbers_in_lists_too():
    changes = {"drop_observation": [np.int64(1)], "delay": (np.int64(1), np.int64(2)), "mass": (np.float64(0.5), np.float32(2))}
    assert recorded(vary(HOPPER, **changes)) == f"{HOPPER}?vary.mass=[0.5,2.0]&vary.delay=[1,2]&vary.drop_observation=[1]"


def test_a_change_that_is_given_in_two_ways_is_refused():
    for given in ('vary.mass={"pole":2}&vary.mass.pole=3', "vary.gravity=2&vary.gravity.=3"):
        with pytest.raises(ConfigError, match="is given twice; leave one out"):
            make_env(f"InvertedPendulum-v5?{given}")
