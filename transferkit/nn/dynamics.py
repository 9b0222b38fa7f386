"""A learnt model of an environment: an ensemble that predicts state changes, rewards and terminations."""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import NamedTuple

import torch
from torch import Tensor, nn

LOG_VAR_BOUNDS = (-10.0, 0.5)
"""Bounds of the predicted variance, in units of the targets' own (Chua et al. 2018 learn them; fixed here)."""

EPSILON = 1e-6
"""Least standard deviation of a target."""


def bounded_log_var(raw: Tensor) -> Tensor:
    """Bring log-variances within the bounds: `low + softplus(high - softplus(high - raw) - low)` (Chua et al. 2018, A.1).

    Written as `exp(-softplus(x)) = sigmoid(-x)` has it, which costs half of the exponentials and logarithms.
    """
    low, high = LOG_VAR_BOUNDS
    return low + torch.log1p(math.exp(high - low) * torch.sigmoid(raw - high))


class Prediction(NamedTuple):
    """Predictions of every member, in the environment's units."""

    next_observation: Tensor
    """`(E, B, obs_dim)`."""
    reward: Tensor
    """`(E, B)`."""
    terminated: Tensor
    """Probability, `(E, B)`."""


class Dynamics(nn.Module):
    """Ensemble of Gaussian networks with a termination head (Chua et al. 2018; Janner et al. 2019).

    The network sees normalised observations and actions, and predicts observation changes and rewards in units of their own
    standard deviations, which `set_statistics` measures.
    """

    mean: Tensor
    """Mean of the targets (observation changes, then the reward), `(obs_dim + 1,)`."""
    std: Tensor
    """Their standard deviation, `(obs_dim + 1,)`."""
    _sin: Tensor
    _cos: Tensor

    def __init__(
        self,
        inputs: nn.Module,
        ensemble: nn.Module,
        obs_dim: int,
        angles: Sequence[tuple[int, int]] = (),
        *,
        absolute: bool = False,
    ) -> None:
        """`angles` are the indices of observation elements that are sine and cosine of one angle.

        With `absolute` the network predicts the next observation itself instead of its change.
        """
        super().__init__()
        self.inputs, self.ensemble, self.obs_dim = inputs, ensemble, obs_dim
        self._kept = 0.0 if absolute else 1.0
        self._has_angles = bool(angles)
        places = torch.tensor(list(angles), dtype=torch.int64).reshape(-1, 2)
        self.register_buffer("_sin", places[:, 0], persistent=False)
        self.register_buffer("_cos", places[:, 1], persistent=False)
        self.register_buffer("mean", torch.zeros(obs_dim + 1))
        self.register_buffer("std", torch.ones(obs_dim + 1))

    @staticmethod
    def out_dim(obs_dim: int) -> int:
        """Count the outputs: mean and log-variance of every target, and the termination logit."""
        return 2 * (obs_dim + 1) + 1

    def forward(self, observation: Tensor, action: Tensor) -> tuple[Tensor, Tensor, Tensor]:
        """Compute mean and log-variance `(E, B, obs_dim + 1)` of the normalised targets, and termination logits `(E, B)`."""
        mean, raw, logit = self._outputs(observation, action)
        return mean, bounded_log_var(raw), logit

    def targets(self, observation: Tensor, reward: Tensor, next_observation: Tensor) -> Tensor:
        """Compute what the means are trained towards, `(..., obs_dim + 1)`."""
        return (self._raw_targets(observation, reward, next_observation) - self.mean) / self.std

    @torch.no_grad()
    def set_statistics(self, observation: Tensor, reward: Tensor, next_observation: Tensor) -> None:
        """Measure the targets' mean and standard deviation, over all leading axes."""
        changes = self._raw_targets(observation, reward, next_observation).flatten(0, -2)
        self.mean.copy_(changes.mean(0))
        self.std.copy_(changes.std(0, correction=0).clamp(min=EPSILON))

    @torch.no_grad()
    def predict(self, observation: Tensor, action: Tensor) -> Prediction:
        """Predict with all members for `(B, obs_dim)`, `(B, act_dim)`, or `(E, B, ...)` for rows of its own each.

        Sines and cosines are put back on the circle.
        """
        mean, _, logit = self._outputs(observation, action)
        change = mean * self.std + self.mean
        following = self._kept * observation + change[..., :-1]
        if self._has_angles:
            sin, cos = following[..., self._sin], following[..., self._cos]
            radius = torch.hypot(sin, cos).clamp(min=EPSILON)
            following[..., self._sin], following[..., self._cos] = sin / radius, cos / radius
        return Prediction(following, change[..., -1], torch.sigmoid(logit))

    def _outputs(self, observation: Tensor, action: Tensor) -> tuple[Tensor, Tensor, Tensor]:
        n = self.obs_dim + 1
        mean, raw, logit = self.ensemble(self.inputs(observation, action)).split((n, n, 1), -1)
        return mean, raw, logit.squeeze(-1)

    def _raw_targets(self, observation: Tensor, reward: Tensor, next_observation: Tensor) -> Tensor:
        return torch.cat((next_observation - self._kept * observation, reward.unsqueeze(-1)), -1)
