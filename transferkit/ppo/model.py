"""transferkit's networks behind the interface that rsl_rl's algorithm expects of its models."""

from __future__ import annotations

from collections.abc import Iterator
from typing import Any

import torch
from torch import Tensor, nn

from transferkit.nn import StateCritic, gaussian
from transferkit.policy.base import Policy
from transferkit.ppo.storage import Minibatch


class Model(nn.Module):
    """What actor and critic have in common."""

    is_recurrent = False

    clipped_by_optimizer = False
    """Set once `PartAdam` clips; rsl_rl, which clips what `parameters` gives it tensor by tensor, then gets nothing."""

    collecting = False
    """While a rollout is collected rsl_rl asks for what `PPO.compute_returns` fills in at once; zeros until then."""

    def parameters(self, recurse: bool = True) -> Iterator[nn.Parameter]:  # noqa: FBT001, FBT002 - torch's signature
        """The parameters, or none where rsl_rl must not clip them again."""
        return iter(()) if self.clipped_by_optimizer else super().parameters(recurse)

    def reset(self, dones: Tensor | None = None, hidden_state: None = None) -> None:
        """No recurrent state."""

    def get_hidden_state(self) -> None:
        """No recurrent state."""


class Actor(Model):
    """A `Policy` as rsl_rl's actor: the distribution of the last forward pass, sampled from a generator of its own."""

    def __init__(self, policy: Policy, noise: torch.Generator, *, entropy_bonus: bool) -> None:
        super().__init__()
        self.policy = policy
        self._entropy_bonus = entropy_bonus
        self.learns_statistics = True
        self.noise = noise
        self.output_distribution_params: tuple[Tensor, Tensor]

    def forward(self, obs: Tensor | Minibatch, *, stochastic_output: bool = False, **_: Any) -> Tensor:  # noqa: ANN401
        """Actions `(B, act_dim)`; sampled while collecting, the mean otherwise."""
        mean, log_std = self.output_distribution_params = self.policy(_tensor(obs))
        if stochastic_output and not torch.is_grad_enabled():  # an update re-reads the density and needs no sample
            return mean + log_std.exp() * torch.randn(mean.shape, generator=self.noise, device=mean.device)
        return mean

    @property
    def output_entropy(self) -> Tensor:
        """Entropy of the last forward pass, `(B,)`."""
        log_std = self.output_distribution_params[1]
        return gaussian.entropy(log_std if self._entropy_bonus else log_std.detach())  # without a bonus, only for the log

    def get_output_log_prob(self, outputs: Tensor) -> Tensor:
        """Log-density of actions under the last forward pass, `(B,)`."""
        if self.collecting:
            return outputs.new_zeros(len(outputs))
        return gaussian.log_prob(*self.output_distribution_params, outputs)

    def get_kl_divergence(self, old_params: tuple[Tensor, Tensor], new_params: tuple[Tensor, Tensor]) -> Tensor:
        """KL(old || new), `(B,)`."""
        return gaussian.kl_divergence(*old_params, *new_params)

    def update_normalization(self, obs: Tensor) -> None:
        """Called by rsl_rl after an update with all observations of the rollout."""
        if self.learns_statistics:
            self.policy.update_normalizer(obs)


class Critic(Model, StateCritic):
    """A `StateCritic` as rsl_rl's critic."""

    def forward(self, obs: Tensor | Minibatch, **_: Any) -> Tensor:  # noqa: ANN401 - rsl_rl passes masks and states
        """Values, `(B, 1)`."""
        return obs.new_zeros(len(obs), 1) if self.collecting and isinstance(obs, Tensor) else self.value(_tensor(obs))

    def update_normalization(self, obs: Tensor) -> None:
        """The policy updates the statistics that both use."""


def _tensor(obs: Tensor | Minibatch) -> Tensor:
    return obs.tensor if isinstance(obs, Minibatch) else obs
