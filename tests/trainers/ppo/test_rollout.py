import numpy as np
import pytest

from tests.trainers.ppo.steps import algorithm, step
from transferkit.config import PPOConfig
from transferkit.trainers.ppo.rollout import RolloutRule, collect


class Scripted:
    """An environment that ends an episode at the steps it is told, counted from 1."""

    num_envs = 1

    def __init__(self, *ends):
        self.ends, self.steps = ends, 0

    def step(self, actions, count=None):
        self.steps += 1
        return step(1.0, terminated=self.steps in self.ends)


@pytest.mark.parametrize(
    ("rollout", "ends", "lengths"),
    [
        ("steps", (6,), [4, 4, 4]),
        ("episode", (1, 3), [1, 2, 4]),
        ("adaptive", (1, 3, 11), [4, 7, 2048]),  # at least 4; on to the end of an episode; not for ever
    ],
)
def test_a_rollout_is_as_long_as_its_kind_says(rollout, ends, lengths):
    ppo, env, found = algorithm(rollout=rollout), Scripted(*ends), []
    observation = np.zeros((1, 2), np.float32)
    for _ in lengths:
        collect(ppo, env, observation, RolloutRule(ppo.config, 1))
        found.append(ppo.storage.step)
        ppo.storage.clear()
    assert found == lengths


def test_a_rollout_waits_no_longer_than_a_twentieth_of_the_budget():
    rule = RolloutRule(PPOConfig(rollout_steps=128), 1)
    assert [rule.is_over(128, ended=False, share=share) for share in (0.04, 0.05)] == [False, True]
    assert not rule.is_over(127, ended=True, share=1.0)


def test_a_rollout_has_a_least_share_of_the_budget():
    rule = RolloutRule(PPOConfig(rollout_steps=128, least_share=0.01), 1)
    assert [rule.is_over(128, ended=True, share=share) for share in (0.009, 0.01)] == [False, True]


@pytest.mark.parametrize(
    ("rollout", "steps", "num_envs", "capacity"),
    [("steps", 128, 4, 32), ("episode", 1000, 1, 1000), ("adaptive", 128, 4, 512), ("adaptive", 4096, 4, 1024)],
)
def test_the_most_steps_of_an_environment_are_known_beforehand(rollout, steps, num_envs, capacity):
    config = PPOConfig(rollout=rollout, rollout_steps=steps, num_envs=num_envs)
    assert RolloutRule(config, num_envs).capacity == capacity


@pytest.mark.parametrize(
    ("rollout", "steps", "sizes"),
    [
        ("steps", 129, [64, 64, 1]),
        ("adaptive", 129, [65, 64]),  # none so small that its noise is a step
        ("adaptive", 50, [50]),
        ("adaptive", 1952, [244] * 8),
    ],
)
def test_an_adaptive_rollout_is_cut_evenly(rollout, steps, sizes):
    assert RolloutRule(PPOConfig(rollout=rollout, batch_size=64), 4).minibatch_sizes(steps) == sizes
