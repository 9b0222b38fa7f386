"""DYNA-PPO, the paper's future work: PPO on short rollouts of a learnt model, between few real episodes.

Real steps train the model and nothing else, imagined ones the policy (as Kurutach et al. 2018, "Model-ensemble trust-region
policy optimization", with PPO and short rollouts from replayed observations).
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace
from typing import TYPE_CHECKING, Any

import numpy as np
import torch
from numpy.typing import NDArray
from torch import nn

from transferkit.errors import ConfigError
from transferkit.nn import Learner
from transferkit.nn.compiled import compiled
from transferkit.policy.critic_and_model import make_dynamics
from transferkit.policy.wrapped_ensemble import learning_parts, thaw
from transferkit.trainers.dyna.diagnostics import diagnose
from transferkit.trainers.dyna.fit import fit, update_model
from transferkit.trainers.dyna.imagined_env import ImaginedEnv
from transferkit.trainers.dyna.replay import ReplayBuffer
from transferkit.trainers.ppo.algorithm import PPO
from transferkit.trainers.ppo.rollout import RolloutRule, collect

if TYPE_CHECKING:
    from transferkit.config import TrainConfig
    from transferkit.envs import VectorEnv
    from transferkit.policy.base import Policy
    from transferkit.run import Session
    from transferkit.spec import IOSpec
    from transferkit.streams import Streams
    from transferkit.trainers.loop import Metrics, Observation


class DynaPPOTrainer:
    """Advances by one environment step, and after every `model.every` of them fits the model and improves the policy in it."""

    num_envs = 1
    overrun_steps = 0

    def __init__(
        self,
        policy: Policy,
        spec: IOSpec,
        config: TrainConfig,
        streams: Streams,
        device: torch.device,
        *,
        compiles: bool = False,
    ) -> None:
        settings = config.dyna_ppo
        self.config, self.device = config, device
        self.model = make_dynamics(
            policy, spec, config.model, streams.torch("model initialisation"), wrapped=config.wrap.dynamics
        ).to(device)
        self.policy, self.hold = policy.to(device), policy.hold
        ppo = replace(config.ppo, rollout="steps", rollout_steps=settings.rollouts * settings.horizon, num_envs=1)
        self.rule = RolloutRule(ppo, settings.rollouts)
        self.algorithm = PPO(
            policy,
            ppo,
            config.network,
            streams,
            device,
            num_envs=settings.rollouts,
            capacity=self.rule.capacity,
            minibatch_sizes=self.rule.minibatch_sizes,
            compiles=compiles,
            learns_statistics=False,  # imagined observations say nothing about real ones
        )
        self.buffer = ReplayBuffer(policy.obs_dim, policy.act_dim, settings.buffer_size, device)
        self.learner = Learner(self.model, learning_parts(self.model, policy), config.model.learning_rate)
        self._update_model = compiled(update_model) if compiles else update_model
        self.noise, self.generator = streams.torch("exploration", device), streams.torch("imagination", device)
        self.fitted = False

    def advance(self, envs: VectorEnv, observation: Observation, session: Session) -> tuple[Observation, Metrics | None]:
        """Take one real step; learn if the model is due.

        Raises:
            ConfigError: the budget ends before the model is fitted once, so that nothing would be learnt.
        """
        action = self.explore(observation)
        every, before = self.config.model.every, session.trained.steps
        step = envs.step(action, session.count)
        self.buffer.add_step(observation, action.clip(-1.0, 1.0), step)
        self.policy.update_normalizer(torch.from_numpy(observation).to(self.device))
        if session.trained.steps // every > before // every:
            return step.observation, self.learn(session)
        if session.progress >= 1 and not self.fitted:
            raise ConfigError(
                f"the budget ended after {session.spent.steps} steps, before dyna-ppo learnt anything: it learns every {every}",
                remedy="give it more {steps}, or a smaller {model.every}",
            )
        return step.observation, None

    @torch.no_grad()
    def explore(self, observation: NDArray[np.float32]) -> NDArray[np.float32]:
        """Draw actions `(1, act_dim)`."""
        mean, log_std = self.policy(torch.from_numpy(observation).to(self.device))
        return (mean + log_std.exp() * torch.randn(mean.shape, generator=self.noise, device=self.device)).cpu().numpy()

    def learn(self, session: Session) -> dict[str, float]:
        """Fit the model to everything seen, then improve the policy in it."""
        progress = session.progress
        if self.fitted:
            session.directory.append(diagnose(self.model, self.buffer, session.spent.steps))
        self.policy.at_progress(progress)
        thaw(self.model, self.policy, progress)
        metrics = {"model": fit(self.learner, self.buffer, self.config.model, self.generator, self._update_model)}
        self.fitted = True
        self.algorithm.set_progress(progress, session.trained.episodes)
        return metrics | self._improve()

    def state(self) -> dict[str, Any]:
        """Return everything that the next step depends on."""
        return {
            "algorithm": self.algorithm.state(),
            "model": self.model.state_dict(),
            "optimizer": self.learner.optimizer.state_dict(),
            "generators": [self.noise.get_state(), self.generator.get_state()],
            "buffer": self.buffer.state(),
            "fitted": self.fitted,
        }

    def restore(self, state: Mapping[str, Any]) -> None:
        """Take what `state` returned."""
        self.algorithm.restore(state["algorithm"])
        self.model.load_state_dict(state["model"])
        self.learner.optimizer.load_state_dict(state["optimizer"])
        for generator, saved in zip((self.noise, self.generator), state["generators"], strict=True):
            generator.set_state(saved)
        self.buffer.restore(state["buffer"])
        self.fitted = state["fitted"]

    def trained(self) -> dict[str, nn.Module]:
        """Return the model and the critic of states."""
        return {"dynamics": self.model, "value": self.algorithm.values}

    def _improve(self) -> dict[str, float]:
        """Update the policy on imagined rollouts."""
        settings, metrics = self.config.dyna_ppo, {}
        imagined = ImaginedEnv(
            self.model,
            self.buffer,
            settings.rollouts,
            members=self.config.model.members,
            horizon=settings.horizon,
            generator=self.generator,
        )
        observation = imagined.reset()
        for _ in range(settings.updates):
            observation = collect(self.algorithm, imagined, observation, self.rule)
            metrics = self.algorithm.learn(observation)
        return metrics
