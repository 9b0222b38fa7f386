"""PPO as a trainer."""

from __future__ import annotations

from collections.abc import Mapping
from typing import TYPE_CHECKING, Any

import torch
from torch import nn

from transferkit.trainers.ppo.algorithm import PPO
from transferkit.trainers.ppo.rollout import RolloutRule, collect

if TYPE_CHECKING:
    from transferkit.config import TrainConfig
    from transferkit.envs import VectorEnv
    from transferkit.policy.base import Policy
    from transferkit.run import Session
    from transferkit.streams import Streams
    from transferkit.trainers.loop import Metrics, Observation


class PPOTrainer:
    """Advances by one rollout and the update that follows it."""

    overrun_steps = 0

    def __init__(
        self, policy: Policy, config: TrainConfig, streams: Streams, device: torch.device, *, compiles: bool = False
    ) -> None:
        self.policy, self.config, self.num_envs, self.hold = policy.to(device), config.ppo, config.ppo.num_envs, policy.hold
        self.rule = RolloutRule(config.ppo, self.num_envs)
        self.algorithm = PPO(
            policy,
            config.ppo,
            config.network,
            streams,
            device,
            num_envs=self.num_envs,
            capacity=self.rule.capacity,
            minibatch_sizes=self.rule.minibatch_sizes,
            compiles=compiles,
        )

    def advance(self, envs: VectorEnv, observation: Observation, session: Session) -> tuple[Observation, Metrics | None]:
        """Collect a rollout and learn from it; what a budget cuts below one minibatch is not learnt from."""
        algorithm = self.algorithm
        self.policy.at_progress(session.progress)
        algorithm.set_progress(session.progress, session.trained.episodes)
        observation = collect(algorithm, envs, observation, self.rule, session)
        if session.progress >= 1 and algorithm.storage.step * self.num_envs < self.config.batch_size:
            return observation, None
        return observation, algorithm.learn(observation) | {"learning_rate": algorithm.learning_rate}

    def state(self) -> dict[str, Any]:
        """Return everything that the next rollout depends on."""
        return self.algorithm.state()

    def restore(self, state: Mapping[str, Any]) -> None:
        """Take what `state` returned."""
        self.algorithm.restore(state)

    def trained(self) -> dict[str, nn.Module]:
        """Return the critic of states."""
        return {"value": self.algorithm.values}
