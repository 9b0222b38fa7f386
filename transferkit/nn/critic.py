"""Values of states, and of states and actions."""

from __future__ import annotations

from collections.abc import Callable
from typing import TYPE_CHECKING

import torch
from torch import Tensor, nn
from torch.func import functional_call

from transferkit.nn.layers import Linear, mlp
from transferkit.nn.normalizer import Shared

if TYPE_CHECKING:
    from transferkit.nn.normalizer import Normalizer

Value = Callable[[Tensor, Tensor], Tensor]
"""Maps observations `(B, obs_dim)` and actions `(B, act_dim)` to values `(B,)`."""


class JointInput(nn.Module):
    """Observations under the policy's statistics beside actions, `(..., obs_dim + act_dim)`."""

    def __init__(self, normalizer: Normalizer | None) -> None:
        super().__init__()
        self._normalize = Shared(normalizer)  # the policy owns it

    def forward(self, observation: Tensor, action: Tensor) -> Tensor:
        """Join what the ensemble sees."""
        return torch.cat((self._normalize(observation), action), -1)


class Critic(nn.Module):
    """`Q(s, a)` of every member, `(E, B)`, for raw observations `(B, obs_dim)` and actions `(B, act_dim)`."""

    def __init__(self, inputs: nn.Module, ensemble: nn.Module) -> None:
        super().__init__()
        self.inputs, self.ensemble = inputs, ensemble

    def forward(self, observation: Tensor, action: Tensor, members: Tensor | None = None) -> Tensor:
        """Compute values, of these members alone if they are given."""
        inputs = self.inputs(observation, action)
        if members is None:
            return self.ensemble(inputs).squeeze(-1)
        weights = {name: parameter[members] for name, parameter in self.ensemble.named_parameters()}
        return functional_call(self.ensemble, weights, inputs).squeeze(-1)

    def value(self, observation: Tensor, action: Tensor) -> Tensor:
        """Average the members, `(B,)`."""
        return self(observation, action).mean(0)


class StateCritic(nn.Module):
    """State values `(B, 1)` from raw observations `(B, obs_dim)`, through the normaliser of the policy."""

    def __init__(
        self,
        obs_dim: int,
        hidden: tuple[int, ...],
        activation: str,
        generator: torch.Generator | None = None,
        *,
        gain: float | None = None,
        zero_bias: bool = True,
        normalizer: Normalizer | None,
    ) -> None:
        super().__init__()
        self.body = mlp(obs_dim, hidden, activation, generator, gain=gain, zero_bias=zero_bias)
        self.head = Linear(hidden[-1], 1, generator, gain=None if gain is None else 1.0, zero_bias=zero_bias)
        self._normalize = Shared(normalizer)  # the policy owns it

    def value(self, observation: Tensor) -> Tensor:
        """Compute values, `(B, 1)`."""
        return self.head(self.body(self._normalize(observation)))
