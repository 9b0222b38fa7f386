"""PPO on steps that are written by hand, of an environment with two observations and one action."""

import numpy as np
import torch

from transferkit.config import NetworkConfig, PPOConfig
from transferkit.envs import Step
from transferkit.nn import Architecture
from transferkit.policy.base import ScratchPolicy
from transferkit.streams import Streams
from transferkit.trainers.ppo.algorithm import PPO
from transferkit.trainers.ppo.rollout import RolloutRule


def algorithm(*, compiles=False, **options):
    config = PPOConfig(**{"num_envs": 1, "rollout_steps": 4, "normalize_reward": False, **options})
    policy = ScratchPolicy.create(Architecture(2, 1, (8,)), Streams(0).torch("policy"), init_std=0.5, normalize=False)
    rule = RolloutRule(config, 1)
    return PPO(
        policy,
        config,
        NetworkConfig(),
        Streams(0),
        torch.device("cpu"),
        num_envs=1,
        capacity=rule.capacity,
        minibatch_sizes=rule.minibatch_sizes,
        compiles=compiles,
    )


def step(reward, *, terminated=False, truncated=False, final=(0.0, 0.0), following=(0.0, 0.0)):
    array = lambda x: np.array([x], np.float32)  # noqa: E731
    return Step(array(following), array(reward), np.array([terminated]), np.array([truncated]), array(final))


@torch.no_grad()
def play(ppo, steps, observation=(0.0, 0.0)):
    """Collect the steps; returns the last observation, from which `learn` goes on."""
    for taken in steps:
        ppo.sample(torch.tensor([observation]))
        ppo.process_step(taken)
        observation = tuple(taken.observation[0].tolist())
    return np.array([observation], np.float32)
