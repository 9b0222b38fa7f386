"""DYNA-PPO, the paper's future work: PPO on short rollouts of a learnt model, between few real episodes.

Real steps train the model and nothing else, imagined ones the policy (as Kurutach et al. 2018, "Model-ensemble trust-region
policy optimization", with PPO and short rollouts from replayed observations).
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace
from typing import Any

import numpy as np
import torch
from numpy.typing import NDArray
from torch import nn

from transferkit import dyna, ppo
from transferkit.config import DynaConfig, PPOConfig
from transferkit.envs.vector import VectorEnv
from transferkit.errors import ConfigError
from transferkit.nn import Dynamics
from transferkit.nn.optimizer import PartAdam
from transferkit.policy.base import Policy
from transferkit.policy.parts import learning_parts, thaw
from transferkit.run.session import Session
from transferkit.run.streams import Streams


class Learner:
    """PPO on imagined rollouts, the model, and the replay buffer behind it."""

    def __init__(
        self, policy: Policy, model: Dynamics, configs: tuple[PPOConfig, DynaConfig], streams: Streams, device: torch.device
    ) -> None:
        ppo_config, self.config = configs
        rollouts = self.config.ppo_rollouts
        self.ppo_config = replace(
            ppo_config,
            num_envs=rollouts,
            rollout="steps",
            rollout_steps=rollouts * self.config.ppo_horizon,
            # By KL divergence, PPO's default, it learnt less on all of four tuning seeds.
            schedule="linear" if ppo_config.schedule == "adaptive" else ppo_config.schedule,
            critic_learning_rate=None,
        )
        self.policy, self.model, self.device = policy, model, device
        self.algorithm = ppo.PPO(policy, self.ppo_config, streams, device)
        self.algorithm.train_mode()
        self.algorithm.actor.learns_statistics = False  # imagined observations say nothing about real ones
        self.buffer = dyna.ReplayBuffer(policy.obs_dim, policy.act_dim, self.config.buffer_size, device)
        self.optimizer = PartAdam(learning_parts(model, policy), self.config.model_learning_rate)
        self.noise, self.generator = streams.torch("exploration", device), streams.torch("imagination", device)
        self.fitted = False

    @torch.no_grad()
    def explore(self, observation: NDArray[np.float32]) -> NDArray[np.float32]:
        """Sampled actions `(1, act_dim)`."""
        mean, log_std = self.policy(torch.from_numpy(observation).to(self.device))
        return (mean + log_std.exp() * torch.randn(mean.shape, generator=self.noise, device=self.device)).cpu().numpy()

    def learn(self, progress: float, episodes: int) -> dict[str, float]:
        """Fit the model to everything seen, then improve the policy in it."""
        metrics = {"model": dyna.fit(self.model, self.optimizer, self.buffer, self.config, self.generator)}
        self.fitted = True
        config = self.config
        world = dyna.ImaginedEnv(
            self.model,
            self.buffer,
            config.ppo_rollouts,
            members=config.model_members,
            horizon=config.ppo_horizon,
            generator=self.generator,
        )
        self.algorithm.set_learning_rate(progress, episodes)
        observation = world.reset()
        for _ in range(config.ppo_updates):
            observation = ppo.collect(self.algorithm, world, observation, self.ppo_config)
            self.algorithm.compute_returns(torch.from_numpy(observation).to(self.device))
            metrics |= self.algorithm.update()
        return metrics

    def state(self) -> dict[str, Any]:
        """Everything that the next step depends on."""
        return {
            "algorithm": self.algorithm.state(),
            "model": self.model.state_dict(),
            "optimizer": self.optimizer.state_dict(),
            "generators": [self.noise.get_state(), self.generator.get_state()],
            "buffer": self.buffer.state(),
            "fitted": self.fitted,
        }

    def restore(self, state: dict[str, Any]) -> None:
        """The inverse of `state`."""
        self.algorithm.restore(dict(state["algorithm"]))
        self.model.load_state_dict(state["model"])
        self.optimizer.load_state_dict(state["optimizer"])
        for generator, saved in zip((self.noise, self.generator), state["generators"], strict=True):
            generator.set_state(saved)
        self.buffer.restore(state["buffer"])
        self.fitted = state["fitted"]


def train(
    policy: Policy,
    model: Dynamics,
    envs: VectorEnv,
    configs: tuple[PPOConfig, DynaConfig],
    session: Session,
    streams: Streams,
    device: torch.device,
    resume_from: Mapping[str, Any] | None = None,
) -> dict[str, nn.Module]:
    """Train the policy and its model in place until the session's budget is reached; returns the model and the critic.

    Raises:
        ConfigError: the budget ends before the model is fitted once, so that nothing would be learnt.
        NotFiniteError: NaN from an environment or in a loss.
        Interrupted: a signal came; the state is on disk.
    """
    learner = Learner(policy.to(device), model.to(device), configs, streams, device)
    if resume_from is None:
        observation = envs.reset()
    else:
        learner.restore(dict(resume_from["learner"]))
        observation = envs.restore(resume_from["envs"])
    while session.progress < 1:
        action = learner.explore(observation)
        step = envs.step(action, session.count)
        learner.buffer.add_step(observation, action.clip(-1.0, 1.0), step)
        policy.update_normalizer(torch.from_numpy(observation).to(device))
        observation = step.observation
        if session.spent.steps % learner.config.model_every == 0:
            if learner.fitted:
                session.directory.append("model", {"steps": session.spent.steps, **dyna.diagnose(model, learner.buffer)})
            policy.at_progress(session.progress)
            thaw(model, policy, session.progress)
            metrics = learner.learn(session.progress, session.spent.episodes)
            session.after_update(metrics, lambda: {"learner": learner.state(), "envs": envs.state()})
    if not learner.fitted:
        raise ConfigError(
            f"the budget ended after {session.spent.steps} steps, before dyna-ppo learnt anything: it learns every "
            f"{learner.config.model_every}; give it more steps, or pass a smaller --dyna.model-every"
        )
    return {"dynamics": model, "value": learner.algorithm.critic}
