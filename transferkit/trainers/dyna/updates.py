"""One environment step's worth of learning as functions of tensors, which run as they are or compiled."""

from __future__ import annotations

from typing import TYPE_CHECKING, NamedTuple

import torch
from torch import Tensor

from transferkit.trainers.dyna.losses import actor_loss, critic_loss

if TYPE_CHECKING:
    from transferkit.nn import Learner
    from transferkit.policy.base import Policy


class Networks(NamedTuple):
    """What learns, and what it is held to."""

    actor: Learner
    critic: Learner
    first_policy: Policy | None
    """The policy as it was at first, if it is held to that."""


class Minibatches(NamedTuple):
    """Consecutive updates' tensors; the leading axis `K` is over updates."""

    observation: Tensor
    """`(K, B, obs_dim)`."""
    action: Tensor
    """`(K, B, act_dim)`."""
    target: Tensor
    """`(K, B)`."""
    critic_rates: Tensor
    """`(K, parts, 2)`, as `PartAdam.rates` has them."""
    actor_rates: Tensor
    """`(K, parts, 2)`."""


def update(networks: Networks, batch: Minibatches, anchor: Tensor, updates_actor: tuple[bool, ...]) -> tuple[Tensor, Tensor]:
    """Update the critic with each minibatch, and after it the actor with those of `updates_actor`; returns the last losses.

    `anchor` is the weight of the distance to the first policy.
    """
    loss = actors_loss = torch.zeros((), device=batch.target.device)
    for k, and_actor in enumerate(updates_actor):
        loss = update_critic(networks.critic, batch.observation[k], batch.action[k], batch.target[k], batch.critic_rates[k])
        if and_actor:
            actors_loss = update_actor(networks, batch.observation[k], anchor, batch.actor_rates[k])
    return loss, actors_loss


def update_critic(critic: Learner, observation: Tensor, action: Tensor, target: Tensor, rates: Tensor) -> Tensor:
    """Step down `critic_loss`."""
    weights = critic.weights()
    loss = critic_loss(lambda *inputs: critic(weights, *inputs), observation, action, target)
    critic.descend(loss, weights, rates)
    return loss.detach()


def update_actor(networks: Networks, observation: Tensor, anchor: Tensor, rates: Tensor) -> Tensor:
    """Step down `actor_loss`."""
    actor, critic = networks.actor, networks.critic
    weights = actor.weights()
    loss = actor_loss(
        lambda inputs: actor(weights, inputs),
        lambda *inputs: critic(critic.optimizer.flat, *inputs),
        observation,
        networks.first_policy,
        anchor,
        squash=bool(actor.module.squash),
    )
    actor.descend(loss, weights, rates)
    return loss.detach()
