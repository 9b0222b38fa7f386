"""Fitting the model to the replay buffer."""

from __future__ import annotations

from typing import TYPE_CHECKING

import torch

from transferkit.trainers.dyna.losses import dynamics_loss, squared_error_loss
from transferkit.trainers.dyna.replay import Batch

if TYPE_CHECKING:
    from transferkit.config import ModelConfig
    from transferkit.nn import Dynamics, PartAdam
    from transferkit.trainers.dyna.replay import ReplayBuffer

HOLDOUT = 0.1
"""Share of the transitions that only decide when to stop."""

HOLDOUT_ROWS = 1000
"""Most of them."""

CHECK_EVERY = 50
"""Updates between looks at them."""

MIN_GAIN = 0.01
"""Least fall of their loss, as a share of it, to go on."""


def fit(model: Dynamics, optimizer: PartAdam, buffer: ReplayBuffer, config: ModelConfig, generator: torch.Generator) -> float:
    """Train at most `updates` batches, fewer once the held-out loss no longer falls; returns the last loss.

    Each member learns from batches of its own. What is held out stays so as long as it is remembered.
    """
    data = buffer.all()
    if config.normalize_targets:
        model.set_statistics(data.observation, data.reward, data.next_observation)
    held_out = _held_out(len(buffer), config, data.reward.device)
    training = torch.nonzero(~held_out).squeeze(-1)
    checking = torch.nonzero(held_out).squeeze(-1)[-HOLDOUT_ROWS:]
    best, loss = float("inf"), torch.zeros(())
    for update in range(config.updates):
        if len(checking) and update % CHECK_EVERY == 0:
            current = _held_out_loss(model, data, checking, config)
            if current > best - MIN_GAIN * abs(best) and update:
                break
            best = current
        shape = config.members, config.batch_size
        rows = training[torch.randint(len(training), shape, generator=generator, device=training.device)]
        optimizer.zero_grad()
        loss = _loss(model, _rows(data, rows), config)
        loss.backward()
        optimizer.step()
    return float(loss.detach())


def _held_out(n: int, config: ModelConfig, device: torch.device) -> torch.Tensor:
    every = round(1 / HOLDOUT)
    if config.updates <= CHECK_EVERY or n < every:
        return torch.zeros(n, dtype=torch.bool, device=device)
    return torch.arange(n, device=device) % every == 0


@torch.no_grad()
def _held_out_loss(model: Dynamics, data: Batch, rows: torch.Tensor, config: ModelConfig) -> float:
    return float(_loss(model, _rows(data, rows.expand(config.members, -1)), config))


def _loss(model: Dynamics, batch: Batch, config: ModelConfig) -> torch.Tensor:
    return dynamics_loss(model, batch) if config.loss == "likelihood" else squared_error_loss(model, batch)


def _rows(data: Batch, rows: torch.Tensor) -> Batch:
    return Batch(*(tensor[rows] for tensor in data))
