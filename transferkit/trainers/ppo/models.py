"""transferkit's networks behind the interface that rsl_rl's algorithm expects of its models while it collects."""

from __future__ import annotations

from collections.abc import Iterator
from typing import TYPE_CHECKING

import torch
from torch import Tensor, nn

from transferkit.nn import StateCritic

if TYPE_CHECKING:
    from transferkit.policy.base import Policy


class Model(nn.Module):
    """What actor and critic have in common."""

    is_recurrent = False
    stand_in: nn.Parameter

    def parameters(self, recurse: bool = True) -> Iterator[nn.Parameter]:  # noqa: FBT001, FBT002 - torch's signature
        """Yield a stand-in: rsl_rl makes an optimiser of what this yields; here `Learner` has one."""
        return iter([self.stand_in])

    def reset(self, dones: Tensor | None = None, hidden_state: None = None) -> None:
        """Do nothing: there is no recurrent state."""

    def get_hidden_state(self) -> None:
        """Return nothing: there is no recurrent state."""


class Actor(Model):
    """A `Policy` as rsl_rl's actor, sampled from a generator of its own."""

    stand_in = nn.Parameter(torch.zeros(1))

    def __init__(self, policy: Policy, noise: torch.Generator) -> None:
        super().__init__()
        self.policy, self.noise = policy, noise

    def sample(self, obs: Tensor) -> tuple[Tensor, tuple[Tensor, Tensor]]:
        """Draw actions `(B, act_dim)`; returns them with the mean and log-std that they were drawn from."""
        mean, log_std = self.policy(obs)
        noise = torch.randn(mean.shape, generator=self.noise, device=mean.device)
        return mean + log_std.exp() * noise, (mean, log_std)


class Critic(Model, StateCritic):
    """A `StateCritic` as rsl_rl's critic."""

    stand_in = nn.Parameter(torch.zeros(1))

    def forward(self, obs: Tensor) -> Tensor:
        """Compute values, `(B, 1)`."""
        return self.value(obs)

    def learnt(self) -> list[nn.Parameter]:
        """Return the parameters."""
        return list(nn.Module.parameters(self))
