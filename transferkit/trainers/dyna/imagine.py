"""Imagined experience: short rollouts of the learnt model from replayed observations (Sutton 1990; Janner et al. 2019)."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING

import torch
from torch import Tensor

from transferkit.trainers.dyna.replay import Batch

if TYPE_CHECKING:
    from transferkit.config import DynaConfig
    from transferkit.nn import Dynamics, Prediction
    from transferkit.policy.base import Policy
    from transferkit.trainers.dyna.replay import ReplayBuffer


@torch.no_grad()
def imagine(
    n: int,
    policy: Policy,
    model: Dynamics,
    buffer: ReplayBuffer,
    config: DynaConfig,
    generator: torch.Generator,
    *,
    noise: float = 0.0,
) -> Tensor:
    """Imagine `n` transitions, as rows of the replay buffer `(n, width)` in random order; `noise` is the actions' deviation.

    Every step takes one member at random for each rollout, drops the share of them on which the members disagree most, and
    starts those that ended anew.
    """
    each = math.ceil(n / config.horizon)
    size = math.ceil(each / config.keep_share)
    observation, rows = None, []
    for _ in range(config.horizon):
        replayed = buffer.split(buffer.sample((size,), generator))
        observation = replayed.observation if observation is None else observation
        action = replayed.action if config.planned_action == "replayed" else _act(policy, observation, noise, generator)
        prediction = model.predict(observation, action)
        batch = _choose(observation, action, prediction, config, generator)
        rows.append(batch.rows()[_agreed(prediction, model, each)])
        observation = torch.where(batch.terminated.unsqueeze(-1) > 0, replayed.observation, batch.next_observation)
    imagined = torch.cat(rows)
    return imagined[torch.randperm(len(imagined), generator=generator, device=imagined.device)[:n]]


@torch.no_grad()
def novelty(model: Dynamics, batch: Batch) -> Tensor:
    """Measure how little the model knows of each transition `(...)`, from 0 to 1, 0.5 at the batch's mean disagreement."""
    lacking = disagreement(model.predict(batch.observation.flatten(0, -2), batch.action.flatten(0, -2)), model)
    return (lacking / (lacking + lacking.mean())).view_as(batch.reward)


def _act(policy: Policy, observation: Tensor, noise: float, generator: torch.Generator) -> Tensor:
    mean = policy(observation)[0]
    return (mean + noise * torch.randn(mean.shape, generator=generator, device=mean.device)).clamp(-1.0, 1.0)


def _choose(
    observation: Tensor, action: Tensor, prediction: Prediction, config: DynaConfig, generator: torch.Generator
) -> Batch:
    """Take one member's next observation and reward for each row, and all members' vote on termination."""
    members, size = prediction.reward.shape
    member = torch.randint(members, (size,), generator=generator, device=observation.device)
    row = torch.arange(size, device=observation.device)
    following = prediction.next_observation[member, row]
    learnt = config.planned_reward == "learned"
    reward = prediction.reward[member, row] if learnt else -torch.linalg.vector_norm(following, dim=-1)
    terminated = (prediction.terminated.mean(0) > 0.5).float()
    return Batch(observation, action, reward, following, terminated if config.planned_termination else terminated * 0.0)


def _agreed(prediction: Prediction, model: Dynamics, count: int) -> Tensor:
    """Find the `count` rows on which the members agree best, in units of the targets' deviation."""
    if len(prediction.next_observation) == 1:
        return torch.arange(count, device=prediction.reward.device)
    return disagreement(prediction, model).topk(count, largest=False, sorted=False).indices


def disagreement(prediction: Prediction, model: Dynamics) -> Tensor:
    """Take the standard deviation over members, in units of the targets' own, mean over elements, `(B,)`."""
    return (prediction.next_observation.std(0) / model.std[:-1]).mean(-1)
