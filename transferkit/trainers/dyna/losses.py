"""Losses of DYNA-DDPG, pure functions of (networks, batch)."""

from __future__ import annotations

from collections.abc import Callable
from typing import TYPE_CHECKING

import torch
from torch import Tensor
from torch.nn import functional

if TYPE_CHECKING:
    from transferkit.trainers.dyna.replay import Batch

Value = Callable[..., Tensor]
"""Maps observations `(B, obs_dim)` and actions `(B, act_dim)` to every critic's values, `(E, B)`; perhaps of given members."""

Actor = Callable[[Tensor], tuple[Tensor, Tensor]]
"""Maps observations `(B, obs_dim)` to mean and log-std of actions, each `(B, act_dim)`."""

Model = Callable[[Tensor, Tensor], tuple[Tensor, Tensor, Tensor]]
"""Maps observations `(E, B, obs_dim)` and actions `(E, B, act_dim)` to what `Dynamics.forward` returns."""


@torch.no_grad()
def td_target(
    policy: Actor,
    critic: Value,
    batch: Batch,
    noise: Tensor | None,
    *,
    reward_scale: float | Tensor,
    discount: float | Tensor,
    pessimism: float = 1.0,
    members: Tensor | None = None,
) -> Tensor:
    """Add the scaled reward and the discounted value of the policy's next action, both of target networks.

    The value is the least of the members, or with less `pessimism` between that and their mean. The batch is `(K, B, ...)`, the
    result and a `discount` of its own for each row `(K, B)`; `members` `(M,)` are those asked, or None for all.

    Lillicrap et al. 2016, equation 5, with the clipped double critic and the action noise of Fujimoto et al. 2018,
    equations 10 and 14, the random subset of Chen et al. 2021, equation 1, and the pessimism of Moskovitz et al. 2021. Only
    terminations cut the bootstrap; time-outs do not.
    """
    observation = batch.next_observation.flatten(0, -2)
    action = policy(observation)[0]
    if noise is not None:
        action = action + noise.view_as(action)
    asked = () if members is None else (members,)
    values = critic(observation, action.clamp(-1.0, 1.0), *asked).view(-1, *batch.reward.shape)
    value = values.amin(0)
    if pessimism < 1.0:
        value = pessimism * value + (1.0 - pessimism) * values.mean(0)
    return reward_scale * batch.reward + discount * (1.0 - batch.terminated) * value


def critic_loss(critic: Value, observation: Tensor, action: Tensor, target: Tensor) -> Tensor:
    """Sum the squared TD error over members (Lillicrap et al. 2016, equation 4)."""
    return (critic(observation, action) - target).square().mean(-1).sum()


def actor_loss(
    policy: Actor,
    critic: Value,
    observation: Tensor,
    first: Actor | None = None,
    weight: Tensor | float = 0.0,
    *,
    squash: bool = False,
) -> Tensor:
    """Deterministic policy gradient (Silver et al. 2014, theorem 1), of the members' mean value.

    A policy that does not `squash` its mean is bounded here. With the policy as it was at `first`: in units of the mean
    absolute value, plus the weighted squared distance to what that one did (Fujimoto & Gu 2021, equation 3).
    """
    mean = policy(observation)[0]
    value = critic(observation, mean if squash else bounded(mean))
    if first is None:
        return -value.mean()
    with torch.no_grad():
        target, scale = first(observation)[0].clamp(-1.0, 1.0), value.abs().mean()
    return -value.mean() / scale + weight * (mean - target).square().mean()


def bounded(action: Tensor) -> Tensor:
    """Clip actions to [-1, 1], with inverted gradients (Hausknecht & Stone 2016, equation 11).

    A gradient step shrinks with the room that is left in its direction, and turns round beyond the bounds. Behind a tanh, which
    saturates, an actor that was once driven to a bound stays there.
    """
    value = action.detach()
    through = action + (value.clamp(-1.0, 1.0) - value)
    if through.requires_grad:
        # A descent step raises the action if its gradient is negative.
        through.register_hook(lambda grad: grad * torch.where(grad < 0, 1.0 - value, 1.0 + value) / 2.0)
    return through


def dynamics_loss(model: Model, batch: Batch, target: Tensor) -> Tensor:
    """Gaussian negative log-likelihood (Chua et al. 2018, equation 1) and cross-entropy of termination.

    The batch has its own rows for each member, `(E, B, ...)`, as has `target`, `(E, B, obs_dim + 1)`; the loss is their sum.
    """
    mean, log_var, logit = model(batch.observation, batch.action)
    likelihood = ((mean - target).square() * torch.exp(-log_var) + log_var).mean((-1, -2)).sum()
    termination = functional.binary_cross_entropy_with_logits(logit, batch.terminated, reduction="none").mean(-1).sum()
    return 0.5 * likelihood + termination


def squared_error_loss(model: Model, batch: Batch, target: Tensor) -> Tensor:
    """Mean squared error of the next observation alone: the paper's model."""
    mean, _, _ = model(batch.observation, batch.action)
    return (mean - target)[..., :-1].square().mean()
