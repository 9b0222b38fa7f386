"""Diagnoses of the model, on the newest transitions."""

from __future__ import annotations

from typing import TYPE_CHECKING

import torch
from torch import Tensor

from transferkit.run.tables import ModelRow
from transferkit.trainers.dyna.imagine import disagreement

if TYPE_CHECKING:
    from transferkit.nn import Dynamics
    from transferkit.trainers.dyna.replay import Batch, ReplayBuffer

EVERY = 250
"""Environment steps between diagnoses, and transitions in each."""


@torch.no_grad()
def diagnose(model: Dynamics, buffer: ReplayBuffer, steps: int) -> ModelRow:
    """Measure the members' mean prediction on the last `EVERY` transitions, after so many environment steps.

    `error_k` is the root mean square error of the observation after k steps, in units of the observation's standard
    deviation over the buffer; NaN if no k consecutive transitions lie within an episode. `reward_error` is a mean absolute
    one in units of the reward's deviation. `terminations_found` is the share of real terminations that were predicted, NaN
    if there were none. The model has seen what came before its last fit: with actions that are held for several steps that is
    most, and with `model.every` below `EVERY` a part. A step of an error is a transition, of a held action.
    """
    recent, everything = buffer.recent(EVERY), buffer.all()
    scale = everything.observation.std(0).clamp(min=1e-6)
    prediction = model.predict(recent.observation, recent.action)
    ended = prediction.terminated.mean(0) > 0.5
    real = recent.terminated > 0.5
    deviation = everything.reward.std().clamp(min=1e-6)
    return ModelRow(
        steps=steps,
        error_1=_open_loop_error(model, recent, scale, 1),
        error_5=_open_loop_error(model, recent, scale, 5),
        error_20=_open_loop_error(model, recent, scale, 20),
        disagreement=float(disagreement(prediction, model).mean()) if len(prediction.reward) > 1 else 0.0,
        reward_error=float((prediction.reward.mean(0) - recent.reward).abs().mean() / deviation),
        termination_accuracy=float((ended == real).float().mean()),
        terminations_found=float(ended[real].float().mean()),
    )


def _open_loop_error(model: Dynamics, batch: Batch, scale: Tensor, k: int) -> float:
    """Predict k steps with the real actions."""
    starts = _starts(batch, k)
    observation = batch.observation[starts]
    for step in range(k):
        observation = model.predict(observation, batch.action[starts + step]).next_observation.mean(0)
    error = (observation - batch.next_observation[starts + k - 1]) / scale
    return float(error.square().mean().sqrt())


def _starts(batch: Batch, k: int) -> Tensor:
    """Find the indices from which `k` transitions follow one another without a reset."""
    joined = (batch.observation[1:] == batch.next_observation[:-1]).all(-1)
    if k == 1:
        return torch.arange(len(batch.reward), device=joined.device)
    if len(joined) < k - 1:
        return torch.arange(0, device=joined.device)
    return torch.nonzero(joined.unfold(0, k - 1, 1).all(-1)).squeeze(-1)
