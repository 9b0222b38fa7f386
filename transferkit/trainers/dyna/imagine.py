"""Imagined experience: short rollouts of the learnt model from replayed observations (Sutton 1990; Janner et al. 2019)."""

from __future__ import annotations

import math
from collections.abc import Callable
from typing import TYPE_CHECKING

import torch
from torch import Tensor

from transferkit.nn import Prediction
from transferkit.trainers.dyna.replay import Batch

if TYPE_CHECKING:
    from transferkit.config import DynaConfig
    from transferkit.nn import Dynamics
    from transferkit.policy.base import Policy
    from transferkit.trainers.dyna.replay import ReplayBuffer


@torch.no_grad()
def imagined_step(
    policy: Policy, model: Dynamics, replayed: Batch, noise: Tensor, config: DynaConfig, members: int
) -> tuple[Batch, Tensor]:
    """Predict a step of rollouts that are at the replayed observations, `(B, ...)`, of which every member has as many.

    `noise` `(B, act_dim)` is added to the policy's actions. If not all rollouts are kept a second member is asked about each:
    whether the episode ends is both members' vote, and the second result is how far they differ, `(B,)`.
    """
    action = replayed.action
    if config.planned_action == "policy":
        action = (policy(replayed.observation)[0] + noise).clamp(-1.0, 1.0)
    own = [tensor.view(members, -1, tensor.shape[-1]) for tensor in (replayed.observation, action)]
    alone = members == 1 or config.keep_share == 1
    asked = own if alone else [torch.cat((tensor, tensor.roll(1, 0)), 1) for tensor in own]
    prediction, rows = model.predict(*asked), own[0].shape[1]
    first = Prediction(*(tensor[:, :rows].flatten(0, 1) for tensor in prediction))
    second = first if alone else Prediction(*(tensor[:, rows:].roll(-1, 0).flatten(0, 1) for tensor in prediction))
    learnt = config.planned_reward == "learned"
    reward = first.reward if learnt else -torch.linalg.vector_norm(first.next_observation, dim=-1)
    ends = (first.terminated + second.terminated > 1.0).float() * config.planned_termination
    difference = (first.next_observation - second.next_observation).abs() / model.std[:-1]
    return Batch(replayed.observation, action, reward, first.next_observation, ends), difference.mean(-1)


@torch.no_grad()
def imagine(
    n: int,
    policy: Policy,
    model: Dynamics,
    buffer: ReplayBuffer,
    config: DynaConfig,
    generator: torch.Generator,
    *,
    members: int,
    noise: float = 0.0,
    step: Callable[..., tuple[Batch, Tensor]] = imagined_step,
) -> Tensor:
    """Imagine `n` transitions, as rows of the replay buffer `(n, width)` in random order; `noise` is the actions' deviation.

    Every step takes one of the model's `members` at random for each rollout, drops the share of them on which another member
    differs most, and starts those that ended anew. `step` is `imagined_step`, compiled or not.
    """
    each = math.ceil(n / config.horizon)
    size = members * math.ceil(each / config.keep_share / members)
    observation: Tensor | None = None
    ended, rows = torch.zeros(()), []
    for _ in range(config.horizon):
        start = buffer.split(buffer.sample((size,), generator))
        if observation is not None:
            order = torch.randperm(size, generator=generator, device=generator.device)
            start = start._replace(observation=torch.where(ended, start.observation, observation)[order])
        draws = noise * torch.randn(size, buffer.act_dim, generator=generator, device=generator.device)
        batch, lacking = step(policy, model, start, draws, config, members)
        rows.append(batch.rows()[lacking.topk(each, largest=False, sorted=False).indices])
        observation, ended = batch.next_observation, batch.terminated.unsqueeze(-1) > 0
    imagined = torch.cat(rows)
    return imagined[torch.randperm(len(imagined), generator=generator, device=imagined.device)[:n]]


@torch.no_grad()
def novelty(model: Dynamics, batch: Batch) -> Tensor:
    """Measure how little the model knows of each transition `(...)`, from 0 to 1, 0.5 at the batch's mean disagreement."""
    lacking = disagreement(model.predict(batch.observation.flatten(0, -2), batch.action.flatten(0, -2)), model)
    return (lacking / (lacking + lacking.mean())).view_as(batch.reward)


def disagreement(prediction: Prediction, model: Dynamics) -> Tensor:
    """Take the standard deviation over members, in units of the targets' own, mean over elements, `(B,)`."""
    return (prediction.next_observation.std(0) / model.std[:-1]).mean(-1)
