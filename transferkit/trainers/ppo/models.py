"""transferkit's networks behind the interface that rsl_rl's algorithm expects of its models."""

from __future__ import annotations

from collections.abc import Iterator
from typing import TYPE_CHECKING

import torch
from torch import Tensor, nn

from transferkit.nn import StateCritic, gaussian
from transferkit.trainers.ppo.storage import Minibatch

if TYPE_CHECKING:
    from transferkit.policy.base import Policy


class Model(nn.Module):
    """What actor and critic have in common."""

    is_recurrent = False
    stand_in: nn.Parameter

    def parameters(self, recurse: bool = True) -> Iterator[nn.Parameter]:  # noqa: FBT001, FBT002 - torch's signature
        """Yield a stand-in: rsl_rl clips and steps what this yields, tensor by tensor; here `PartAdam` does it at once."""
        return iter([self.stand_in])

    def reset(self, dones: Tensor | None = None, hidden_state: None = None) -> None:
        """Do nothing: there is no recurrent state."""

    def get_hidden_state(self) -> None:
        """Return nothing: there is no recurrent state."""


class Actor(Model):
    """A `Policy` as rsl_rl's actor: the distribution of the last forward pass, sampled from a generator of its own."""

    stand_in = nn.Parameter(torch.zeros(1))

    def __init__(self, policy: Policy, noise: torch.Generator, *, entropy_bonus: bool, learns_statistics: bool = True) -> None:
        super().__init__()
        self.policy = policy
        self._entropy_bonus, self._learns_statistics = entropy_bonus, learns_statistics
        self.noise = noise
        self.output_distribution_params: tuple[Tensor, Tensor]

    def forward(self, obs: Tensor | Minibatch, **_: object) -> Tensor:
        """Compute the distribution of actions; returns its mean `(B, act_dim)`, for an update needs no sample."""
        self.output_distribution_params = self.policy(as_tensor(obs))
        return self.output_distribution_params[0]

    def sample(self, obs: Tensor) -> tuple[Tensor, tuple[Tensor, Tensor]]:
        """Draw actions `(B, act_dim)`; returns them with the mean and log-std that they were drawn from."""
        mean, log_std = self.policy(obs)
        noise = torch.randn(mean.shape, generator=self.noise, device=mean.device)
        return mean + log_std.exp() * noise, (mean, log_std)

    @property
    def output_entropy(self) -> Tensor:
        """Entropy of the last forward pass, `(B,)`."""
        log_std = self.output_distribution_params[1]
        return gaussian.entropy(log_std if self._entropy_bonus else log_std.detach())  # without a bonus, only for the log

    def get_output_log_prob(self, outputs: Tensor) -> Tensor:
        """Compute the log-density of actions under the last forward pass, `(B,)`."""
        return gaussian.log_prob(*self.output_distribution_params, outputs)

    def get_kl_divergence(self, old_params: tuple[Tensor, Tensor], new_params: tuple[Tensor, Tensor]) -> Tensor:
        """Compute KL(old || new), `(B,)`."""
        return gaussian.kl_divergence(*old_params, *new_params)

    def update_normalization(self, obs: Tensor) -> None:
        """Take all observations of a rollout, after rsl_rl's update, into the policy's statistics."""
        if self._learns_statistics:
            self.policy.update_normalizer(obs)


class Critic(Model, StateCritic):
    """A `StateCritic` as rsl_rl's critic."""

    stand_in = nn.Parameter(torch.zeros(1))

    def forward(self, obs: Tensor | Minibatch, **_: object) -> Tensor:
        """Compute values, `(B, 1)`."""
        return self.value(as_tensor(obs))

    def update_normalization(self, obs: Tensor) -> None:
        """Do nothing: the policy updates the statistics that both use."""

    def learnt(self) -> list[nn.Parameter]:
        """Return the parameters."""
        return list(nn.Module.parameters(self))


def as_tensor(obs: Tensor | Minibatch) -> Tensor:
    """Unpack observations."""
    return obs.tensor if isinstance(obs, Minibatch) else obs
