"""Diagonal Gaussians as pure functions of (mean, log_std), both `(B, act_dim)`; sums run over actions."""

from __future__ import annotations

import math
from typing import Any

import torch
from torch import Tensor

LOG_STD_BOUNDS = (-5.0, 1.0)
"""Standard deviations in [0.007, 2.7] of an action range of [-1, 1]; the exponent outside is noise or a dead policy."""


def log_prob(mean: Tensor, log_std: Tensor, action: Tensor) -> Tensor:
    """Compute the log-density of actions `(B, act_dim)`, `(B,)`; differentiable in mean and log_std."""
    return _LogProb.apply(mean, log_std, action)


def entropy(log_std: Tensor) -> Tensor:
    """Compute the differential entropy in nats, `(B,)`."""
    return log_std.sum(-1) + 0.5 * math.log(2 * math.pi * math.e) * log_std.shape[-1]


def kl_divergence(old_mean: Tensor, old_log_std: Tensor, mean: Tensor, log_std: Tensor) -> Tensor:
    """Compute KL(old || new), `(B,)`."""
    variance_ratio = torch.exp(2 * (old_log_std - log_std))
    distance = ((old_mean - mean) * torch.exp(-log_std)) ** 2
    return (log_std - old_log_std + 0.5 * (variance_ratio + distance - 1)).sum(-1)


class _LogProb(torch.autograd.Function):
    """One node in the graph instead of eight: a sixth of a PPO update on small networks (`make bench`)."""

    @staticmethod
    def forward(ctx: Any, mean: Tensor, log_std: Tensor, action: Tensor) -> Tensor:  # noqa: ANN401 - torch's context
        inverse_std = torch.exp(-log_std)
        z = (action - mean) * inverse_std
        ctx.save_for_backward(z, inverse_std)
        return (-0.5 * z * z - log_std).sum(-1) - 0.5 * math.log(2 * math.pi) * action.shape[-1]

    @staticmethod
    def backward(ctx: Any, *grads: Tensor) -> tuple[Tensor, Tensor, None]:  # noqa: ANN401
        z, inverse_std = ctx.saved_tensors
        upstream = grads[0].unsqueeze(-1)
        return upstream * z * inverse_std, upstream * (z * z - 1), None
