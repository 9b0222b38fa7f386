"""The contract of make_env and derive_spec, over every environment."""

import json
from typing import get_args

import gymnasium
import numpy as np
import pytest
from gymnasium.wrappers import TimeLimit

import envs_dmc
from envs_dmc.suite import MODEL_SEED, suite, without_rendering
from transferkit.envs import VectorEnv, derive_spec, environment_ids, episode_limit, is_written, make_env, recorded, time_step
from transferkit.reading import parse
from transferkit.spec import IOSpec, Quantity

IDS = environment_ids()
STEPS = 25


def rollout(env, seed, steps=STEPS):
    actions = np.random.default_rng(0).uniform(-1.2, 1.2, (steps, *env.action_space.shape)).astype(np.float32)
    observations, rewards = [env.reset(seed=seed)[0]], []
    for action in actions:
        observation, reward, terminated, truncated, _ = env.step(action)
        observations.append(observation)
        rewards.append(reward)
        if terminated or truncated:
            break
    return np.array(observations), np.array(rewards)


def test_all_of_both_backends_are_there():
    assert len(IDS) == 11 + len(suite.ALL_TASKS) == len(set(IDS))


@pytest.mark.parametrize("env_id", IDS)
def test_deterministic_from_a_seed_whatever_came_before(env_id):
    env, other = make_env(env_id), make_env(env_id)
    first = rollout(env, 3)
    rollout(env, 4)
    for again in (rollout(env, 3), rollout(other, 3)):
        np.testing.assert_array_equal(first[0], again[0])
        np.testing.assert_array_equal(first[1], again[1])
    assert not np.array_equal(first[0][0], rollout(env, 4)[0][0]) or "lqr" in env_id or "sparse" in env_id
    assert first[0].dtype == np.float32
    assert env.observation_space.shape == first[0].shape[1:]
    assert env.action_space == gymnasium.spaces.Box(-1, 1, env.action_space.shape, np.float32)
    assert time_step(env) > 0


@pytest.mark.parametrize("env_id", IDS)
def test_equals_the_native_environment_step_by_step(env_id):
    ours, rewards = rollout(make_env(env_id), 3)
    native = native_dm_control if env_id.startswith("dm_control/") else native_gymnasium
    expected, expected_rewards = native(env_id, len(rewards))
    np.testing.assert_array_equal(ours, np.array(expected, np.float32))
    np.testing.assert_array_equal(rewards, expected_rewards)


def native_actions(low, high, steps):
    actions = np.random.default_rng(0).uniform(-1.2, 1.2, (steps, len(low))).astype(np.float32)
    low, high = low.astype(np.float64), high.astype(np.float64)
    return (low + high) / 2 + (high - low) / 2 * np.clip(actions, -1, 1)


def native_gymnasium(env_id, steps):
    env = gymnasium.make(env_id)
    observations, rewards = [env.reset(seed=3)[0]], []
    for action in native_actions(env.action_space.low, env.action_space.high, steps):
        observation, reward, *_ = env.step(action)
        observations.append(observation)
        rewards.append(reward)
    return observations, rewards


def native_dm_control(env_id, steps):
    domain, task = env_id.removeprefix("dm_control/").removesuffix("-v0").split("-")
    env = suite.load(domain, task, task_kwargs={"random": MODEL_SEED})
    without_rendering(env.physics)  # quadruped-escape opens a screen at every reset
    env.task._random = np.random.RandomState(3)
    flat = lambda timestep: np.concatenate([np.ravel(v) for v in timestep.observation.values()])  # noqa: E731
    observations, rewards = [flat(env.reset())], []
    spec = env.action_spec()
    bound = np.where(spec.maximum > 1e9, 1.0, spec.maximum)
    for action in native_actions(np.where(spec.minimum < -1e9, -1.0, spec.minimum), bound, steps):
        timestep = env.step(action)
        observations.append(flat(timestep))
        rewards.append(timestep.reward)
    return observations, rewards


@pytest.mark.parametrize("env_id", IDS)
def test_the_spec_adds_up(env_id):
    env = make_env(env_id)
    spec = derive_spec(env_id)
    assert (spec.obs_dim, spec.act_dim) == (env.observation_space.shape[0], env.action_space.shape[0])
    assert (spec.time_step, spec.episode_limit) == (time_step(env), episode_limit(env))
    joints = {joint.name for joint in spec.joints}
    assert len(joints) == len(spec.joints)
    assert len({element.name for element in spec.observation}) == spec.obs_dim
    for element in spec.observation:
        assert element.quantity in get_args(Quantity)
        assert set(element.joints) <= joints
        assert len(element.coefficients) in (0, len(element.joints))
    for actuator in spec.action:
        assert actuator.joint is None or actuator.joint in joints
        assert actuator.low < actuator.high
    assert parse(json.dumps(spec.to_json()), IOSpec) == spec


@pytest.mark.parametrize("env_id", [env_id for env_id in IDS if env_id.startswith("dm_control/")])
def test_a_dm_control_time_out_is_a_truncation(env_id):
    env = make_env(env_id)
    env.unwrapped.dm_env._step_limit = env.unwrapped.episode_limit = 5
    check_time_out(env, 5)


def test_a_limit_of_its_own_is_known_and_outlives_other_rules():
    made = make_env("InvertedPendulum-v5", max_episode_steps=3)
    again = make_env(made, clip_actions=False)
    assert (episode_limit(made), episode_limit(again), again.clip) == (3, 3, False)
    assert episode_limit(make_env("InvertedPendulum-v5", max_episode_steps=5000)) == 1000
    longer = TimeLimit(gymnasium.make("InvertedPendulum-v5"), 5000)
    assert (episode_limit(longer), is_written(recorded(longer))) == (1000, False)


@pytest.mark.parametrize("env_id", [env_id for env_id in IDS if not env_id.startswith("dm_control/")])
def test_a_gymnasium_time_out_is_a_truncation(env_id):
    check_time_out(make_env(gymnasium.make(env_id, max_episode_steps=2)), 2)


def check_time_out(env, limit):
    envs = VectorEnv([env], lambda _, episode: episode)
    first = envs.reset()
    action = np.zeros((1, *env.action_space.shape), np.float32)
    for k in range(limit):
        step = envs.step(action)
        assert not step.terminated[0]
        assert step.truncated[0] == (k == limit - 1)
    twin = env  # the true final observation, from the same episode without the reset
    twin.reset(seed=0)
    for _ in range(limit):
        final = twin.step(action[0])[0]
    np.testing.assert_array_equal(step.final_observation[0], final)
    np.testing.assert_array_equal(step.observation[0], twin.reset(seed=1)[0])
    assert first.shape == step.observation.shape


def test_the_suite_limit_is_the_one_we_state():
    assert suite.load("cartpole", "balance")._step_limit == envs_dmc.EPISODE_LIMIT


def test_pendulum_and_cartpole_have_the_same_names():
    pendulum, cartpole = derive_spec("InvertedPendulum-v5"), derive_spec("dm_control/cartpole-balance-v0")
    assert [joint.name for joint in pendulum.joints] == [joint.name for joint in cartpole.joints] == ["slide_x", "hinge_y"]
    assert [e.name for e in cartpole.observation] == [
        "slide_x.position", "hinge_y.cos", "hinge_y.sin", "slide_x.velocity", "hinge_y.velocity",
    ]  # fmt: skip
