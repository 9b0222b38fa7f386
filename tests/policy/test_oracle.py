"""A frozen pendulum core behind a linear 6 -> 4 map can balance two poles: the paper's idea is representable.

It proves no more than that: any core whose action responds along one direction can carry the map (the second test).
"""

import mujoco
import numpy as np
import pytest
import torch
from scipy.linalg import solve_discrete_are

from transferkit import load_core, make_env
from transferkit.streams import Streams

NUDGE = 1e-5


@pytest.fixture(scope="module")
def env():
    return make_env("InvertedDoublePendulum-v5")


@pytest.fixture(scope="module")
def lqr_gain(env):
    """Discrete LQR of the double pendulum, linearised by finite differences of one control step, `(6,)`."""
    model, data = env.unwrapped.model, env.unwrapped.data

    def step(state, control):
        mujoco.mj_resetData(model, data)
        data.qpos[:], data.qvel[:], data.ctrl[:] = state[:3], state[3:], control
        for _ in range(env.unwrapped.frame_skip):
            mujoco.mj_step(model, data)
        return np.concatenate([data.qpos, data.qvel])

    a = np.stack([(step(NUDGE * e, 0) - step(-NUDGE * e, 0)) / (2 * NUDGE) for e in np.eye(6)], axis=1)
    b = ((step(np.zeros(6), NUDGE) - step(np.zeros(6), -NUDGE)) / (2 * NUDGE))[:, None]
    p = solve_discrete_are(a, b, np.diag([1, 10, 10, 0.1, 0.1, 0.1]), [[10.0]])
    return np.linalg.solve(10.0 + b.T @ p @ b, b.T @ p @ a)[0]


def linear_adapter(policy, normalizer, gain):
    """The map `state -> offset + matrix @ state` under which the policy's action is -gain @ state to first order."""

    def action(x):
        with torch.no_grad():
            return policy(torch.tensor(x[None], dtype=torch.float32))[0].item()

    def gradient(x):
        return np.array([(action(x + 1e-3 * e) - action(x - 1e-3 * e)) / 2e-3 for e in np.eye(4)])

    offset = normalizer.mean.numpy().astype(float)
    for _ in range(10):  # Newton, to where the core is at rest
        g = gradient(offset)
        offset = offset - action(offset) * g / (g @ g)
    g = gradient(offset)
    return offset, np.outer(g / (g @ g), -gain)


def play(env, policy, offset, matrix, seed):
    observation, total = env.reset(seed=seed)[0], 0.0
    while True:
        x, s1, s2, c1, c2, v, w1, w2, _ = observation
        state = np.array([x, np.arctan2(s1, c1), np.arctan2(s2, c2), v, w1, w2])
        action = policy.act((offset + matrix @ state).astype(np.float32)[None])[0]
        observation, reward, terminated, truncated, _ = env.step(action)
        total += reward
        if terminated or truncated:
            return total


def test_the_optimal_gain_has_one_sign(lqr_gain):
    assert (lqr_gain > 0).all() or (lqr_gain < 0).all()


@pytest.mark.parametrize("member", range(5))
def test_every_frozen_member_balances_two_poles(env, lqr_gain, member):
    core = load_core("inverted-pendulum-v1")
    policy = core.policy(member)
    adapter = linear_adapter(policy, core.normalizer(member), lqr_gain)
    assert min(play(env, policy, *adapter, seed) for seed in range(3)) > 9300


def test_a_random_core_does_too(env, lqr_gain):
    core = load_core("inverted-pendulum-v1").randomized(0)
    policy = core.policy(0)
    torch.nn.init.normal_(policy.network.mean_head.weight, generator=Streams(0).torch("head"))
    adapter = linear_adapter(policy, core.normalizer(0), lqr_gain)
    assert play(env, policy, *adapter, seed=0) > 9300
