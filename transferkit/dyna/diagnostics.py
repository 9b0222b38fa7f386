"""How good the model is, on the newest transitions, which it has not been fitted to yet."""

from __future__ import annotations

import torch
from torch import Tensor

from transferkit.dyna.imagine import disagreement
from transferkit.dyna.replay import Batch, ReplayBuffer
from transferkit.nn.dynamics import Dynamics

EVERY = 250
"""Environment steps between diagnoses, and transitions in each."""

HORIZONS = (1, 5, 20)
"""Steps of open-loop prediction with the real actions."""


@torch.no_grad()
def diagnose(model: Dynamics, buffer: ReplayBuffer) -> dict[str, float]:
    """Errors of the members' mean prediction on the last `EVERY` transitions.

    `error_k` is the root mean square error of the observation after k steps, in units of the observation's standard
    deviation over the buffer; NaN where no k consecutive transitions lie within an episode. `reward_error` is a mean absolute
    one in units of the reward's deviation. `terminations_found` is the share of real terminations that were predicted, NaN
    where there were none. With `model_every` below `EVERY` the model has seen a part of them.
    """
    recent, everything = buffer.recent(EVERY), buffer.all()
    scale = everything.observation.std(0).clamp(min=1e-6)
    prediction = model.predict(recent.observation, recent.action)
    ended = prediction.terminated.mean(0) > 0.5
    real = recent.terminated > 0.5
    deviation = everything.reward.std().clamp(min=1e-6)
    return {
        **{f"error_{k}": _open_loop_error(model, recent, scale, k) for k in HORIZONS},
        "disagreement": float(disagreement(prediction, model).mean()) if len(prediction.reward) > 1 else 0.0,
        "reward_error": float((prediction.reward.mean(0) - recent.reward).abs().mean() / deviation),
        "termination_accuracy": float((ended == real).float().mean()),
        "terminations_found": float(ended[real].float().mean()),
    }


def _open_loop_error(model: Dynamics, batch: Batch, scale: Tensor, k: int) -> float:
    starts = _starts(batch, k)
    observation = batch.observation[starts]
    for step in range(k):
        observation = model.predict(observation, batch.action[starts + step]).next_observation.mean(0)
    error = (observation - batch.next_observation[starts + k - 1]) / scale
    return float(error.square().mean().sqrt())


def _starts(batch: Batch, k: int) -> Tensor:
    """Indices from which `k` transitions follow one another without a reset."""
    joined = (batch.observation[1:] == batch.next_observation[:-1]).all(-1)
    if k == 1:
        return torch.arange(len(batch.reward), device=joined.device)
    if len(joined) < k - 1:
        return torch.arange(0, device=joined.device)
    return torch.nonzero(joined.unfold(0, k - 1, 1).all(-1)).squeeze(-1)
