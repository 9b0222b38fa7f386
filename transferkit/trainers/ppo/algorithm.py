"""rsl_rl's PPO, subclassed for exact bootstrapping, learning rates per part and a rollout of any length."""

from __future__ import annotations

import os
from collections.abc import Callable, Mapping, Sequence
from typing import TYPE_CHECKING, Any, cast

os.environ.setdefault("GIT_PYTHON_REFRESH", "quiet")  # rsl_rl imports git, which raises if there is no git binary

import numpy as np
import rsl_rl.algorithms
import torch
from gymnasium.wrappers.utils import RunningMeanStd
from numpy.typing import NDArray
from torch import Tensor

from transferkit.nn import Part, PartAdam, gaussian
from transferkit.trainers.ppo.models import Actor, Critic
from transferkit.trainers.ppo.storage import Storage

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
    """Collects with `sample` and `process_step`, learns with `compute_returns` and `update`; GAE and the update are rsl_rl's.

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
        learns_statistics: bool = True,
    ) -> None:
        """Make critic, storage and optimiser around a policy; `network` shapes the critic."""
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
        actor = Actor(policy, self.noise, entropy_bonus=config.entropy_coefficient > 0, learns_statistics=learns_statistics)
        critic = _critic(policy, network, streams)
        super().__init__(
            cast("Any", actor),
            cast("Any", critic),
            storage,
            num_learning_epochs=config.epochs,
            clip_param=config.clip,
            gamma=config.gamma,
            lam=config.lam,
            value_loss_coef=config.value_coefficient,
            entropy_coef=config.entropy_coefficient,
            learning_rate=config.learning_rate,
            use_clipped_value_loss=False,
            schedule=config.schedule,
            desired_kl=config.desired_kl,
            normalize_advantage_per_mini_batch=config.normalize_advantage == "batch",
            device=str(device),
        )
        self.sampler, self.values, self.rollouts = actor, critic, storage
        parts = [Part(group.parameters, group.lr_scale, "actor") for group in policy.parameter_groups()]
        parts.append(Part(critic.learnt(), clip_group="critic", lr=config.critic_learning_rate))
        self.optimizer = cast("Any", PartAdam(parts, config.learning_rate, max_grad_norm=config.max_grad_norm))
        self.returns = RunningMeanStd(shape=())
        self._running_return = np.zeros(num_envs)
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
        if self.config.value_target == "monte-carlo":
            monte_carlo_returns(storage, self.gamma)
        self.num_mini_batches = storage.num_mini_batches
        with torch.enable_grad():
            return self.update()

    def set_learning_rate(self, progress: float, episodes: int) -> None:
        """Follow the schedule to this share of the budget and number of episodes."""
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
            "returns": [float(self.returns.mean), float(self.returns.var), float(self.returns.count)],
            "running_return": self._running_return.tolist(),
        }

    def restore(self, state: Mapping[str, Any]) -> None:
        """Take what `state` returned."""
        self.load(state["models"], None, strict=True)
        self.learning_rate = state["learning_rate"]
        self.noise.set_state(state["noise"])
        self.batches.set_state(state["minibatches"])
        self.returns.mean, self.returns.var, self.returns.count = state["returns"]
        self._running_return = np.array(state["running_return"])

    def _scale(self, step: Step) -> NDArray[np.float32]:
        """Divide rewards by the running deviation of the discounted return."""
        if not self.config.normalize_reward:
            return step.reward
        self._running_return = self._running_return * self.gamma + step.reward
        self.returns.update(self._running_return)
        self._running_return[step.done] = 0.0
        scaled = step.reward / np.sqrt(self.returns.var + 1e-8)
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
