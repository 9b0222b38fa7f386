"""rsl_rl's PPO, subclassed for exact bootstrapping, learning rates per part and a rollout of any length."""

from __future__ import annotations

import os
from typing import Any, cast

os.environ.setdefault("GIT_PYTHON_REFRESH", "quiet")  # rsl_rl imports git, which raises where no git binary exists

import numpy as np
import rsl_rl.algorithms
import torch
from gymnasium.wrappers.utils import RunningMeanStd
from numpy.typing import NDArray
from torch import Tensor

from transferkit.config import PPOConfig
from transferkit.envs.vector import Step
from transferkit.nn import gaussian
from transferkit.nn.optimizer import Part, PartAdam
from transferkit.policy.base import Policy
from transferkit.ppo.model import Actor, Critic
from transferkit.ppo.storage import Storage
from transferkit.run.streams import Streams

STEP_DECAY_EPISODES, STEP_DECAY = 100, 0.9
"""The paper's StepLR, per episode."""

REWARD_CLIP = 10.0
"""Standard deviations; as in OpenAI baselines' VecNormalize."""


class PPO(rsl_rl.algorithms.PPO):
    """Collects with `act` and `process_env_step`, learns with `compute_returns` and `update`; all four are rsl_rl's.

    Added: the value of the true final observation at time-outs, reward scaling, Monte-Carlo value targets, schedules.
    """

    actor: Actor  # type: ignore[assignment]
    critic: Critic  # type: ignore[assignment]
    storage: Storage  # type: ignore[assignment]

    def __init__(self, policy: Policy, config: PPOConfig, streams: Streams, device: torch.device) -> None:
        storage = Storage(
            config.num_envs,
            config.capacity,
            policy.obs_dim,
            policy.act_dim,
            minibatch_sizes=config.minibatch_sizes,
            shuffle=config.shuffle,
            generator=streams.torch("minibatches", device),
        )
        critic = Critic(
            policy.obs_dim,
            config.hidden,
            config.activation,
            streams.torch("critic initialisation"),
            gain=2**0.5,
            zero_bias=config.std != "head",
            normalizer=policy.normalizer,
        )
        self.noise = streams.torch("action noise", device)
        super().__init__(
            cast("Any", Actor(policy, self.noise, entropy_bonus=config.entropy_coefficient > 0)),
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
        self.config = config
        groups = policy.parameter_groups()
        parts = [Part(group.parameters, group.lr_scale, "actor") for group in groups]
        parts.append(Part(list(critic.parameters()), clip_group="critic", lr=config.critic_learning_rate))
        self.optimizer = cast("Any", PartAdam(parts, config.learning_rate, max_grad_norm=config.max_grad_norm))
        self.actor.clipped_by_optimizer = self.critic.clipped_by_optimizer = True
        self.returns = RunningMeanStd(shape=())
        self._running_return = np.zeros(config.num_envs)

    def set_collecting(self, *, now: bool) -> None:
        """Whether steps are collected or learnt from."""
        self.actor.collecting = self.critic.collecting = now

    def process_step(self, step: Step) -> None:
        """Record one step of all environments."""
        reward = torch.from_numpy(self._scale(step)).to(self.device)
        if self.config.bootstrap_timeouts and step.truncated.any():
            final_value = self.critic.value(torch.from_numpy(step.final_observation).to(self.device)).squeeze(-1)
            reward += self.gamma * final_value * torch.from_numpy(step.truncated).to(self.device)
        self.process_env_step(cast("Any", None), reward, torch.from_numpy(step.done).to(self.device), {})

    @torch.no_grad()
    def compute_returns(self, obs: Tensor) -> None:  # type: ignore[override]
        """Advantages by GAE, and the value targets; `obs` are the observations after the last step."""
        storage = self.storage
        storage.close()
        self.set_collecting(now=False)
        mean, log_std = cast("tuple[Tensor, Tensor]", storage.distribution_params)
        storage.values.copy_(self.critic.value(storage.observations))
        storage.actions_log_prob.copy_(gaussian.log_prob(mean, log_std, storage.actions).unsqueeze(-1))
        super().compute_returns(cast("Any", obs))
        if self.config.value_target == "monte-carlo":
            following = torch.zeros_like(self.storage.rewards[0])
            for step in reversed(range(self.storage.step)):
                going_on = 1.0 - self.storage.dones[step].float()
                following = self.storage.rewards[step] + self.gamma * going_on * following
                self.storage.returns[step] = following

    def update(self) -> dict[str, float]:
        """Learn from the rollout; mean losses over its minibatches."""
        self.num_mini_batches = self.storage.num_mini_batches
        return super().update()

    def set_learning_rate(self, progress: float, episodes: int) -> None:
        """The schedule's learning rate at this share of the budget and number of episodes."""
        if self.schedule == "linear":
            self.learning_rate = self.config.learning_rate * (1 - progress)
        elif self.schedule == "step":
            self.learning_rate = self.config.learning_rate * STEP_DECAY ** (episodes // STEP_DECAY_EPISODES)
        for group in self.optimizer.param_groups:
            group["lr"] = self.learning_rate

    def state(self) -> dict[str, Any]:
        """Everything that the next update depends on, between two rollouts."""
        return {
            "models": self.save(),
            "learning_rate": self.learning_rate,
            "noise": self.noise.get_state(),
            "minibatches": self.storage._generator.get_state(),  # noqa: SLF001 - its own storage
            "returns": [float(self.returns.mean), float(self.returns.var), float(self.returns.count)],
            "running_return": self._running_return.tolist(),
        }

    def restore(self, state: dict[str, Any]) -> None:
        """The inverse of `state`."""
        self.load(state["models"], None, strict=True)
        self.learning_rate = state["learning_rate"]
        self.noise.set_state(state["noise"])
        self.storage._generator.set_state(state["minibatches"])  # noqa: SLF001
        self.returns.mean, self.returns.var, self.returns.count = state["returns"]
        self._running_return = np.array(state["running_return"])

    def _scale(self, step: Step) -> NDArray[np.float32]:
        if not self.config.normalize_reward:
            return step.reward
        self._running_return = self._running_return * self.gamma + step.reward
        self.returns.update(self._running_return)
        self._running_return[step.done] = 0.0
        scaled = step.reward / np.sqrt(self.returns.var + 1e-8)
        return np.clip(scaled, -REWARD_CLIP, REWARD_CLIP).astype(np.float32)
