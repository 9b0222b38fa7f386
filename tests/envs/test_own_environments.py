"""What users bring goes through every call: derived, matched with itself to the bit, wrapped, evaluated, recorded."""

import gymnasium
import mujoco
import numpy as np
import pytest
from dm_control import composer, mjcf, suite
from dm_control.composer.observation import observable
from gymnasium.wrappers import FlattenObservation
from shimmy.dm_control_compatibility import DmControlCompatibilityV0

from tests.envs.own import (
    ARM,
    MODELS,
    PENDULUM,
    STACKS,
    NeedsAnAction,
    Plain,
    Repeat,
    Strict,
    WaitsForTheClock,
    pendulum,
)
from tests.policy.cores import random_core
from transferkit import derive_spec, evaluate, make_env, scratch_policy, vary, wrap
from transferkit.envs import copies_of, environment_ids, episode_limit, is_written, open_simulation, recorded
from transferkit.errors import EnvironmentContractError
from transferkit.record.play import Subject, record_episodes
from transferkit.record.replay import replay_recording


class Task(composer.Task):
    """A composer task with flat observations."""

    def __init__(self):
        self._arena = composer.Arena()
        root = mjcf.RootElement(model="bob")
        body = root.worldbody.add("body", name="bob")
        self.joint = body.add("joint", name="swing", type="hinge", axis=[0, 1, 0])
        body.add("geom", type="capsule", fromto=[0, 0, 0, 0, 0, -0.4], size=[0.05])
        root.actuator.add("motor", joint=self.joint, ctrlrange=[-1, 1], ctrllimited=True)
        self._arena.mjcf_model.attach(root)
        self._task_observables = {name: observable.MJCFFeature(name, self.joint) for name in ("qpos", "qvel")}
        for one in self._task_observables.values():
            one.enabled = True
        self.set_timesteps(control_timestep=0.02, physics_timestep=0.005)

    @property
    def root_entity(self):
        return self._arena

    @property
    def task_observables(self):
        return self._task_observables

    def get_reward(self, physics):
        return 1.0


NATIVE = {
    "suite": lambda: suite.load("cartpole", "balance"),
    "composer": lambda: composer.Environment(Task(), time_limit=1.0, strip_singleton_obs_buffer_dim=True),
    "in Shimmy's wrapper": lambda: DmControlCompatibilityV0(suite.load("cartpole", "balance")),
    "flattened": lambda: FlattenObservation(DmControlCompatibilityV0(suite.load("cartpole", "balance"))),
}
MAKERS = {
    **{name: (lambda xml=xml: Plain(xml)) for name, xml in MODELS.items()},
    **NATIVE,
    **{name: make for name, (make, _) in STACKS.items()},
}


@pytest.mark.parametrize("name", [*environment_ids(), *MAKERS])
def test_a_core_is_the_identity_on_its_own_environment(name):
    spec = derive_spec(MAKERS.get(name, name))
    core = random_core(spec)
    observation = np.random.default_rng(0).normal(size=(16, spec.obs_dim)).astype(np.float32)
    expected = core.policy().act(observation)
    for tap in ("features", "action"):
        np.testing.assert_array_equal(wrap(core, spec, tap=tap, adapter="semantic").act(observation), expected)


@pytest.mark.parametrize("name", MAKERS)
def test_it_is_evaluated_recorded_and_replayed(name, tmp_path):
    make, path = MAKERS[name], tmp_path / "played.mcap"
    policy = scratch_policy(make)
    instance = make()
    assert evaluate(policy, instance, episodes=1, max_episode_steps=20).lengths[0] <= 20
    played = record_episodes(Subject(policy, make, max_episode_steps=20), path)
    assert played[0].steps <= 20
    spec = derive_spec(instance)
    if name not in (
        "normalised",
        "noise without a seed",
        "noise that repeats itself",
        "noise in proportion",
    ):  # which mean something else by now
        assert spec == derive_spec(make)
    assert spec.time_step > 0
    if is_written(spec.env_id):
        assert not replay_recording(path).difference


@pytest.mark.parametrize("name", STACKS)
def test_the_elements_behind_wrappers_are_named(name):
    make, names = STACKS[name]
    spec = derive_spec(make())
    assert tuple(element.name for element in spec.observation) == names
    if name == "units":
        assert {(element.coefficients, element.offset) for element in spec.observation} == {((2.0,), 1.0)}
    elif name == "noise in proportion":
        assert {element.offset for element in spec.observation} == {0.0}
        np.testing.assert_allclose([element.coefficients[0] for element in spec.observation], 1.0, atol=0.02)
    elif name not in ("low pass", "noise without a seed", "noise that repeats itself"):
        formed = [element for element in spec.observation if element.coefficients]
        assert {(element.coefficients, element.offset) for element in formed} == {((1.0,), 0.0)}
    assert [e.quantity for e in spec.observation if not e.coefficients] == {
        "previous action": ["action"],
        "frames with actions": ["action", "action"],
        "time": ["time"],
        "clocks": ["time", "unknown", "unknown"],
        "low pass": ["unknown"] * 4,
    }.get(name, [])


def test_a_normaliser_of_the_users_own_is_warned_about_and_left_as_it_was(caplog):
    env = STACKS["normalised"][0]()
    env.reset(seed=0)
    before = env.obs_rms.mean.copy(), env.obs_rms.count
    derive_spec(env)
    assert "NormalizeObservation of InvertedPendulum-v5 learns outside the policy" in caplog.text
    np.testing.assert_array_equal(env.obs_rms.mean, before[0])
    assert env.obs_rms.count == before[1]
    assert env.update_running_mean


def test_time_is_what_passes_in_the_simulation():
    assert derive_spec(Plain(MODELS["motors"])).time_step == pytest.approx(0.01)
    assert derive_spec(Repeat(pendulum())).time_step == pytest.approx(0.16)


class Slotted:
    """Keeps the simulation in slots."""

    __slots__ = ("d", "m")

    def __init__(self, model, data):
        self.m, self.d = model, data


@pytest.mark.parametrize("keep", [lambda m, d: (m, d), lambda m, d: {"m": m, "d": d}, Slotted, lambda m, d: [d]])
def test_a_model_is_found_wherever_it_is_kept(keep):
    class Hidden(Plain):
        def __init__(self, xml):
            super().__init__(xml)
            self.sim = keep(self.robot, self.state)

        @property
        def hidden(self):
            kept = self.sim
            return [kept.m, kept.d] if isinstance(kept, Slotted) else [*(kept.values() if isinstance(kept, dict) else kept)]

        def __getattr__(self, name):
            if name in ("robot", "state") and "sim" in vars(self):
                kind = mujoco.MjModel if name == "robot" else mujoco.MjData
                found = next((one for one in self.hidden if isinstance(one, kind)), None)
                return self.hidden[0].model if found is None else found
            raise AttributeError(name)

    env = Hidden(MODELS["motors"])
    del env.__dict__["robot"], env.__dict__["state"]
    assert derive_spec(env).observation == derive_spec(Plain(MODELS["motors"])).observation


def test_an_observation_that_needs_an_argument(tmp_path):
    path = tmp_path / "arm.xml"
    path.write_text(MODELS["motors"])
    names = [element.name for element in derive_spec(NeedsAnAction(path)).observation]
    assert names[:4] == ["slide_z.position", "hinge_y.position", "slide_z.velocity", "hinge_y.velocity"]
    assert names[4:] == ["drive.slide_z.action", "drive.hinge_y.action"]


@pytest.mark.parametrize("kind", [WaitsForTheClock, Strict])
def test_a_step_that_waits_for_a_time_or_ends_for_good(kind):
    spec = derive_spec(kind(MODELS["motors"]))
    expected = derive_spec(Plain(MODELS["motors"]))
    assert spec.observation == expected.observation
    assert spec.action == expected.action
    assert spec.time_step == pytest.approx({"WaitsForTheClock": 0.02, "Strict": 0.01}[kind.__name__])


def test_an_action_is_measured_where_no_joint_is_at_its_limit():
    limited = MODELS["motors"].replace('axis="0 1 0"', 'axis="0 1 0" range="20 60" limited="true" frictionloss="5"')
    free, held = (derive_spec(Plain(xml)).action[1].authority for xml in (MODELS["motors"], limited))
    assert held == pytest.approx(free)


def test_a_copy_is_as_the_environment_is_now():
    env = gymnasium.make(PENDULUM)
    env.unwrapped.model.opt.gravity[2], env.unwrapped.frame_skip = -1.0, 3
    copies = copies_of(env)
    assert (copies().unwrapped.model.opt.gravity[2], copies().unwrapped.frame_skip) == (-1.0, 3)
    assert copies().unwrapped.model is not env.unwrapped.model
    assert recorded(env) == f"<{PENDULUM}, changed>"
    weak = vary(PENDULUM, gear=0.02)
    twin = copies_of(weak)()
    for one in (weak, twin):
        one.reset(seed=0)
        one.step(np.array([3.0]))
    np.testing.assert_array_equal(weak.unwrapped.data.qpos, twin.unwrapped.data.qpos)
    assert twin.unwrapped.model.actuator_gear[0, 0] == pytest.approx(2.0)
    twin.reset(seed=1)
    assert twin.unwrapped.model.actuator_gear[0, 0] == pytest.approx(2.0)


def test_actuators_without_a_range_are_refused():
    with pytest.raises(EnvironmentContractError, match=r"action 0 of Plain has bounds 0 to 0 .* ctrlrange"):
        make_env(Plain(ARM.format('<actuator><motor joint="turn"/></actuator>')))


def test_an_environment_that_does_not_stay_where_it_is_put_is_unknown(caplog):
    class Drifting(Plain):
        def step(self, action):
            self.state.qpos[:] += 0.1
            return super().step(action)

    spec = derive_spec(Drifting(MODELS["motors"]))
    assert {element.quantity for element in spec.observation} == {"unknown"}
    assert "what Drifting observes is not known" in caplog.text


@pytest.mark.parametrize("name", ["suite", "composer"])
def test_a_native_environment_of_dm_control_has_its_limit_and_order(name):
    native = NATIVE[name]()
    env = make_env(native)
    assert episode_limit(env) == {"suite": 1000, "composer": 50}[name]
    keys = list(native.observation_spec())
    assert list(dict.fromkeys(env.unwrapped.observation_keys())) == keys
    assert open_simulation(env).backend == "dm_control"
    assert all(element.quantity != "unknown" for element in derive_spec(native).observation)


def test_a_model_that_was_changed_is_not_said_to_be_its_id():
    env = gymnasium.make("Hopper-v5", frame_skip=2, max_episode_steps=7)
    assert recorded(env) == "Hopper-v5?frame_skip=2&max_episode_steps=7"
    env.unwrapped.model.body_mass[1] *= 2
    assert recorded(env) == "<Hopper-v5?frame_skip=2&max_episode_steps=7, changed>"
