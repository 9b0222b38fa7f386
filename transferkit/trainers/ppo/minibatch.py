"""rsl_rl's update of one minibatch as a function of tensors, which runs as it is or compiled.

The losses and their order are `rsl_rl.algorithms.PPO.update`'s own code. It is handed a minibatch, networks that are functions
of flat weights, and an optimiser whose step is tensor operations.
"""

from __future__ import annotations

import math
from collections.abc import Generator, Iterator
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING, Any, NamedTuple, cast

import rsl_rl.algorithms
import torch
from rsl_rl.storage import RolloutStorage
from torch import Tensor

from transferkit.config.ppo import ADAPTIVE_RATES
from transferkit.nn import gaussian

if TYPE_CHECKING:
    from transferkit.nn import Learner

KL_FACTOR, RATE_FACTOR = 2.0, 1.5
"""rsl_rl's rule of the adaptive schedule: how far the KL divergence may be off, and what the rate is changed by."""


class Minibatch(NamedTuple):
    """Samples of a rollout; every tensor is `(B, ...)`."""

    observations: Tensor
    actions: Tensor
    values: Tensor
    advantages: Tensor
    returns: Tensor
    actions_log_prob: Tensor
    mean: Tensor
    log_std: Tensor


@dataclass(frozen=True)
class Rule:
    """Settings that rsl_rl's update reads from its algorithm, under their names there."""

    clip_param: float
    value_loss_coef: float
    entropy_coef: float
    max_grad_norm: float | None
    """Gradient norm limit of the actor and of the critic; None for none."""
    normalize_advantage_per_mini_batch: bool
    device: str
    desired_kl: float | None
    """Nats that the learning rate follows; None if it is fixed within a rollout."""


def update_minibatch(
    rule: Rule, actor: Learner, critic: Learner, minibatch: Minibatch, rates: tuple[Tensor, Tensor], learning_rate: Tensor
) -> dict[str, float]:
    """Step actor and critic down rsl_rl's loss; returns its value, surrogate and entropy.

    `rates` are both optimisers' of this step, for a learning rate of one; `learning_rate` follows the KL divergence in place.
    """
    if rule.normalize_advantage_per_mini_batch and len(minibatch.actions) == 1:  # rsl_rl divides by its deviation, NaN
        minibatch = minibatch._replace(advantages=torch.zeros_like(minibatch.advantages))
        rule = replace(rule, normalize_advantage_per_mini_batch=False)
    models = _Actor(actor, rule, minibatch), _Critic(critic)
    optimizer = _Optimizer(models, rates, learning_rate, rule.max_grad_norm)
    stand_in = _Algorithm(rule, *models, optimizer, OneMinibatch(minibatch))
    return rsl_rl.algorithms.PPO.update(cast("Any", stand_in))


class Observations:
    """Observations `(B, obs_dim)` that tell rsl_rl their `batch_size`, as a TensorDict does at many times the cost."""

    __slots__ = ("batch_size", "tensor")

    def __init__(self, tensor: Tensor) -> None:
        self.tensor, self.batch_size = tensor, tensor.shape[:1]


class _Model:
    """A network for one forward and backward pass."""

    is_recurrent = False

    def __init__(self, learner: Learner) -> None:
        self.learner, self.weights = learner, learner.weights()

    def parameters(self) -> Iterator[Tensor]:
        """Nothing that rsl_rl would clip, tensor by tensor: `_Optimizer` does."""
        return iter(())

    def clipped_gradients(self, max_norm: float | None) -> list[Tensor]:
        """Gradients of the flat weights, at most of this norm together."""
        grads = [torch.zeros_like(weights) if weights.grad is None else weights.grad for weights in self.weights]
        if max_norm is None:
            return grads
        norm = torch.stack([grad.square().sum() for grad in grads]).sum().sqrt()
        return [grad / (norm / max_norm).clamp(min=1.0) for grad in grads]

    def update_normalization(self, obs: Tensor) -> None:
        """Do nothing: that follows the whole rollout's update."""


class _Actor(_Model):
    def __init__(self, learner: Learner, rule: Rule, minibatch: Minibatch) -> None:
        super().__init__(learner)
        self.rule, self.old = rule, (minibatch.mean, minibatch.log_std)
        self.output_distribution_params: tuple[Tensor, Tensor]

    def __call__(self, obs: Observations, **_: object) -> None:
        self.output_distribution_params = self.learner(self.weights, obs.tensor)

    def get_output_log_prob(self, actions: Tensor) -> Tensor:
        return gaussian.log_prob(*self.output_distribution_params, actions)

    @property
    def output_entropy(self) -> Tensor:
        log_std = self.output_distribution_params[1]
        return gaussian.entropy(log_std if self.rule.entropy_coef else log_std.detach())  # without a bonus, only for the log

    def adapted(self, learning_rate: Tensor) -> Tensor:
        """The learning rate by rsl_rl's rule, if it follows the KL divergence."""
        desired = self.rule.desired_kl
        if desired is None:
            return learning_rate
        kl = gaussian.kl_divergence(*self.old, *self.output_distribution_params).mean()
        factor = torch.where(kl > desired * KL_FACTOR, 1 / RATE_FACTOR, 1.0)
        factor = torch.where((kl < desired / KL_FACTOR) & (kl > 0), RATE_FACTOR, factor)
        return (learning_rate * factor).clamp(ADAPTIVE_RATES.low, ADAPTIVE_RATES.high)


class _Critic(_Model):
    def __call__(self, obs: Observations, **_: object) -> Tensor:
        return self.learner(self.weights, obs.tensor)


class _Optimizer:
    def __init__(
        self, models: tuple[_Actor, _Critic], rates: tuple[Tensor, Tensor], learning_rate: Tensor, max_grad_norm: float | None
    ) -> None:
        self.models, self.rates, self.learning_rate, self.max_grad_norm = models, rates, learning_rate, max_grad_norm

    def zero_grad(self) -> None:
        """Do nothing: the weights are new."""

    @torch.no_grad()
    def step(self) -> None:
        self.learning_rate.copy_(self.models[0].adapted(self.learning_rate))
        for model, rates in zip(self.models, self.rates, strict=True):
            grads = model.clipped_gradients(self.max_grad_norm)
            model.learner.optimizer.apply(grads, rates, self.learning_rate)


class OneMinibatch:
    """A storage whose update is one minibatch."""

    def __init__(self, minibatch: Minibatch) -> None:
        self.observations, self._minibatch = minibatch.observations, minibatch

    def mini_batch_generator(self, _count: int, _epochs: int) -> Generator[RolloutStorage.Batch]:
        """Yield it, as rsl_rl's batch."""
        rows = self._minibatch
        yield RolloutStorage.Batch(
            observations=cast("Any", Observations(rows.observations)),
            actions=rows.actions,
            values=rows.values,
            advantages=rows.advantages,
            returns=rows.returns,
            old_actions_log_prob=rows.actions_log_prob,
            old_distribution_params=(rows.mean, rows.log_std),
        )

    def clear(self) -> None:
        """Do nothing: the rollout is not over."""


class _Algorithm:
    """What rsl_rl's update reads of itself."""

    rnd = symmetry = None
    use_mixed_precision = use_clipped_value_loss = is_multi_gpu = False
    num_mini_batches = num_learning_epochs = 1
    schedule, desired_kl = "fixed", None  # the optimiser follows the schedule, without a branch on a tensor

    def __init__(self, rule: Rule, actor: _Actor, critic: _Critic, optimizer: _Optimizer, storage: OneMinibatch) -> None:
        self.actor, self.critic, self.optimizer, self.storage = actor, critic, optimizer, storage
        self.clip_param, self.value_loss_coef, self.entropy_coef = rule.clip_param, rule.value_loss_coef, rule.entropy_coef
        self.max_grad_norm, self.device = math.inf, rule.device
        self.normalize_advantage_per_mini_batch = rule.normalize_advantage_per_mini_batch
