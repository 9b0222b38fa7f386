"""rsl_rl's PPO, subclassed for exact bootstrapping, learning rates per part and a rollout of any length."""

from __future__ import annotations

import os
from collections.abc import Callable, Mapping, Sequence
from typing import TYPE_CHECKING, Any, cast

os.environ.setdefault("GIT_PYTHON_REFRESH", "quiet")  # rsl_rl imports git, which raises if there is no git binary

import numpy as np
import rsl_rl.algorithms
import torch
from numpy.typing import NDArray
from torch import Tensor

from transferkit.nn import Learner, Part, gaussian
from transferkit.nn.compiled import compiled, mark_varying
from transferkit.trainers.ppo.minibatch import Rule, update_minibatch
from transferkit.trainers.ppo.models import Actor, Critic
from transferkit.trainers.ppo.optimizers import Optimizers
from transferkit.trainers.ppo.storage import Storage
from transferkit.trainers.running_return import RunningReturn

if TYPE_CHECKING:
    from transferkit.config import NetworkConfig, PPOConfig
    from transferkit.envs import Step
    from transferkit.policy.base import Policy
    from transferkit.streams import Streams

STEP_DECAY_EPISODES, STEP_DECAY = 100, 0.9
"""The paper's StepLR, per episode."""

REWARD_CLIP = 10.0
"""Standard deviations; as in OpenAI baselines' VecNormalize."""


class PPO(rsl_rl.algorithms.PPO):
    """Collects with `sample` and `process_step`, learns with `compute_returns` and `update`; GAE and the losses are rsl_rl's.

    Added: the value of the true final observation at time-outs, reward scaling, Monte-Carlo value targets, schedules.
    """

    def __init__(
        self,
        policy: Policy,
        config: PPOConfig,
        network: NetworkConfig,
        streams: Streams,
        device: torch.device,
        *,
        num_envs: int,
        capacity: int,
        minibatch_sizes: Callable[[int], Sequence[int]],
        compiles: bool = False,
        learns_statistics: bool = True,
    ) -> None:
        """Make critic, storage and optimiser around a policy; `network` shapes the critic, `compiles` compiles the updates."""
        self.policy, self.config = policy, config
        self.noise, self.batches = streams.torch("action noise", device), streams.torch("minibatches", device)
        storage = Storage(
            num_envs,
            capacity,
            policy.obs_dim,
            policy.act_dim,
            minibatch_sizes=minibatch_sizes,
            shuffle=config.shuffle,
            generator=self.batches,
        )
        actor = Actor(policy, self.noise)
        critic = _critic(policy, network, streams)
        super().__init__(
            cast("Any", actor),
            cast("Any", critic),
            storage,
            num_learning_epochs=config.epochs,
            gamma=config.gamma**policy.hold,
            lam=config.lam,
            learning_rate=config.learning_rate,
            schedule=config.schedule,
            normalize_advantage_per_mini_batch=config.normalize_advantage == "batch",
            device=str(device),
        )
        self.sampler, self.values, self.rollouts = actor, critic, storage
        self._learns_statistics = learns_statistics
        self.rule = Rule(
            config.clip,
            config.value_coefficient,
            config.entropy_coefficient,
            config.max_grad_norm,
            normalize_advantage_per_mini_batch=config.normalize_advantage == "batch",
            device=str(device),
            desired_kl=config.desired_kl if config.schedule == "adaptive" else None,
        )
        parts = [Part(group.parameters, group.lr_scale) for group in policy.parameter_groups()]
        learnt = [Part(critic.learnt(), lr=config.critic_learning_rate)]
        self.learners = Learner(policy, parts, config.learning_rate), Learner(critic, learnt, config.learning_rate)
        self.optimizer = cast("Any", Optimizers([learner.optimizer for learner in self.learners]))
        self._update_minibatch = compiled(update_minibatch) if compiles else update_minibatch
        self._compiles, self._critic_only = compiles, False
        self.returns = RunningReturn(num_envs, self.gamma)
        self.train_mode()

    def sample(self, obs: Tensor) -> Tensor:
        """Draw actions `(num_envs, act_dim)` and note them for the storage.

        In place of rsl_rl's `act`: values and log-densities are filled in for the whole rollout at once, by
        `compute_returns`.
        """
        action, params = self.sampler.sample(obs)
        later, note = action.new_zeros(len(action), 1), cast("Any", self.transition)
        note.observations, note.actions, note.distribution_params = obs, action, params
        note.values = note.actions_log_prob = later
        return action

    def process_step(self, step: Step) -> None:
        """Record one step of all environments."""
        reward = torch.from_numpy(self._scale(step)).to(self.device)
        if self.config.bootstrap_timeouts and step.truncated.any():
            final_value = self.values.value(torch.from_numpy(step.final_observation).to(self.device)).squeeze(-1)
            reward = reward + self.gamma * final_value * torch.from_numpy(step.truncated).to(self.device)
        self.process_env_step(cast("Any", None), reward, torch.from_numpy(step.done).to(self.device), {})

    @torch.no_grad()
    def learn(self, observation: NDArray[np.float32]) -> dict[str, float]:
        """Learn from the rollout, which the observations `(num_envs, obs_dim)` follow; mean losses over its minibatches."""
        storage = self.rollouts
        storage.close()
        mean, log_std = cast("tuple[Tensor, Tensor]", storage.distribution_params)
        storage.values.copy_(self.values.value(cast("Tensor", storage.observations)))
        storage.actions_log_prob.copy_(gaussian.log_prob(mean, log_std, storage.actions).unsqueeze(-1))
        self.compute_returns(cast("Any", torch.from_numpy(observation).to(self.device)))
        if storage.step * storage.num_envs == 1 and not self.rule.normalize_advantage_per_mini_batch:
            cast("Tensor", storage.advantages).zero_()  # over its own mean; rsl_rl divides by the deviation of one, NaN
        if self.config.value_target == "monte-carlo":
            monte_carlo_returns(storage, self.gamma)
        with torch.enable_grad():
            return self.update()

    def update(self) -> dict[str, float]:
        """Take rsl_rl's update of every minibatch, the statistics of observations after them; mean losses."""
        storage, epochs = self.rollouts, self.num_learning_epochs
        count = epochs * storage.num_mini_batches
        learning_rate = torch.tensor(self.learning_rate, device=self.device)
        rates = [learner.optimizer.rates(count, lr=1.0) for learner in self.learners]
        if self._critic_only:
            rates[0] = torch.zeros_like(rates[0])
        total: dict[str, float] = dict.fromkeys(("value", "surrogate", "entropy"), 0.0)
        for k, minibatch in enumerate(storage.minibatches(epochs)):
            if self._compiles and (self.config.rollout != "steps" or len(minibatch.actions) != self.config.batch_size):
                mark_varying(minibatch)
            step_rates = rates[0][k], rates[1][k]
            losses = self._update_minibatch(self.rule, *self.learners, minibatch, step_rates, learning_rate)
            total = {name: total[name] + losses[name] / count for name in total}
        if self._critic_only:  # nothing of a critic that knows nothing yet, in Adam's moments neither
            self.learners[0].optimizer.forget()
        else:  # a policy that stays tells nothing of the rate
            self.learning_rate = float(learning_rate)
        if self._learns_statistics:
            self.policy.update_normalizer(cast("Tensor", storage.observations).flatten(0, 1))
        storage.clear()
        return total

    def set_progress(self, progress: float, episodes: int) -> None:
        """Follow the schedules to this share of the budget and number of episodes."""
        self._critic_only = self.policy.has_core and progress < self.config.critic_first
        if self.schedule == "linear":
            self.learning_rate = self.config.learning_rate * (1 - progress)
        elif self.schedule == "step":
            self.learning_rate = self.config.learning_rate * STEP_DECAY ** (episodes // STEP_DECAY_EPISODES)
        for group in self.optimizer.param_groups:
            group["lr"] = self.learning_rate

    def state(self) -> dict[str, Any]:
        """Return everything that the next update depends on, between two rollouts."""
        return {
            "models": self.save(),
            "learning_rate": self.learning_rate,
            "noise": self.noise.get_state(),
            "minibatches": self.batches.get_state(),
            **self.returns.state(),
        }

    def restore(self, state: Mapping[str, Any]) -> None:
        """Take what `state` returned."""
        self.load(state["models"], None, strict=True)
        self.learning_rate = state["learning_rate"]
        self.noise.set_state(state["noise"])
        self.batches.set_state(state["minibatches"])
        self.returns.restore(state)

    def _scale(self, step: Step) -> NDArray[np.float32]:
        """Divide rewards by the running deviation of the discounted return."""
        if not self.config.normalize_reward:
            return step.reward
        self.returns.add(step.reward, step.done)
        scaled = step.reward / self.returns.deviation
        return np.clip(scaled, -REWARD_CLIP, REWARD_CLIP).astype(np.float32)


def monte_carlo_returns(storage: Storage, gamma: float) -> None:
    """Replace the value targets by plain discounted returns; an episode that the rollout cuts ends there."""
    following = torch.zeros_like(storage.rewards[0])
    for step in reversed(range(storage.step)):
        going_on = 1.0 - storage.dones[step].float()
        following = storage.rewards[step] + gamma * going_on * following
        storage.returns[step] = following


def _critic(policy: Policy, network: NetworkConfig, streams: Streams) -> Critic:
    return Critic(
        policy.obs_dim,
        network.hidden,
        network.activation,
        streams.torch("critic initialisation"),
        gain=2**0.5,
        zero_bias=network.initialization != "paper",
        normalizer=policy.normalizer,
    )
