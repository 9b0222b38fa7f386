"""Fitting the model to the replay buffer."""

from __future__ import annotations

from collections.abc import Callable
from typing import TYPE_CHECKING

import torch
from torch import Tensor

from transferkit.nn import Dynamics
from transferkit.trainers.dyna.losses import dynamics_loss, squared_error_loss
from transferkit.trainers.dyna.replay import Batch

if TYPE_CHECKING:
    from transferkit.config import ModelConfig
    from transferkit.nn import Learner
    from transferkit.trainers.dyna.replay import ReplayBuffer

Loss = Callable[..., Tensor]
"""`dynamics_loss` or `squared_error_loss`."""

HOLDOUT = 0.1
"""Share of the transitions that only decide when to stop."""

HOLDOUT_ROWS = 1000
"""Most of them."""

CHECK_EVERY = 50
"""Updates between looks at them."""

MIN_GAIN = 0.01
"""Least fall of their loss, as a share of it, to go on."""


def update_model(learner: Learner, batch: Batch, target: Tensor, rates: Tensor, loss: Loss) -> Tensor:
    """Step down a loss of the model."""
    weights = learner.weights()
    value = loss(lambda *inputs: learner(weights, *inputs), batch, target)
    learner.descend(value, weights, rates)
    return value.detach()


def fit(
    learner: Learner,
    buffer: ReplayBuffer,
    config: ModelConfig,
    generator: torch.Generator,
    update: Callable[..., Tensor] = update_model,
) -> float:
    """Train a `Dynamics` with at most `updates` batches, fewer once the held-out loss no longer falls; returns the last loss.

    Each member learns from batches of its own. What is held out stays so as long as it is remembered.
    """
    data, model = buffer.all(), _dynamics(learner)
    loss_of = dynamics_loss if config.loss == "likelihood" else squared_error_loss
    if config.normalize_targets:
        model.set_statistics(data.observation, data.reward, data.next_observation)
    held_out = _held_out(len(buffer), config, data.reward.device)
    training = torch.nonzero(~held_out).squeeze(-1)
    checking = torch.nonzero(held_out).squeeze(-1)[-HOLDOUT_ROWS:]
    best, loss, rates = float("inf"), torch.zeros(()), torch.zeros(())
    for k in range(config.updates):
        if len(checking) and k % CHECK_EVERY == 0:
            held = _rows(data, checking.expand(config.members, -1))
            with torch.no_grad():
                current = float(loss_of(model, held, _targets(model, held)))
            if current > best - MIN_GAIN * abs(best) and k:
                break
            best = current
        if k % CHECK_EVERY == 0:
            rates = learner.optimizer.rates(min(CHECK_EVERY, config.updates - k))
        shape = config.members, config.batch_size
        rows = training[torch.randint(len(training), shape, generator=generator, device=training.device)]
        batch = _rows(data, rows)
        loss = update(learner, batch, _targets(model, batch), rates[k % CHECK_EVERY], loss_of)
    return float(loss)


def _held_out(n: int, config: ModelConfig, device: torch.device) -> torch.Tensor:
    every = round(1 / HOLDOUT)
    if config.updates <= CHECK_EVERY or n < every:
        return torch.zeros(n, dtype=torch.bool, device=device)
    return torch.arange(n, device=device) % every == 0


def _dynamics(learner: Learner) -> Dynamics:
    assert isinstance(learner.module, Dynamics)
    return learner.module


def _targets(model: Dynamics, batch: Batch) -> Tensor:
    return model.targets(batch.observation, batch.reward, batch.next_observation)


def _rows(data: Batch, rows: torch.Tensor) -> Batch:
    return Batch(*(tensor[rows] for tensor in data))
