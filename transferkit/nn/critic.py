"""State-action values as an ensemble."""

from __future__ import annotations

import torch
from torch import Tensor, nn

from transferkit.nn.normalizer import Normalizer


class JointInput(nn.Module):
    """Observations under the policy's statistics beside actions, `(..., obs_dim + act_dim)`."""

    def __init__(self, normalizer: Normalizer | None) -> None:
        super().__init__()
        # In a list, so that the statistics are saved once, with the policy they belong to.
        self._normalizer = [normalizer or nn.Identity()]

    def forward(self, observation: Tensor, action: Tensor) -> Tensor:
        """What the ensemble sees."""
        return torch.cat((self._normalizer[0](observation), action), -1)


class Critic(nn.Module):
    """`Q(s, a)` of every member, `(E, B)`, for raw observations `(B, obs_dim)` and actions `(B, act_dim)`."""

    def __init__(self, inputs: nn.Module, ensemble: nn.Module) -> None:
        super().__init__()
        self.inputs, self.ensemble = inputs, ensemble

    def forward(self, observation: Tensor, action: Tensor) -> Tensor:
        """Values."""
        return self.ensemble(self.inputs(observation, action)).squeeze(-1)
