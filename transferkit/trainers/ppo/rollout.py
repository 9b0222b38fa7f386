"""Collecting a rollout: how long it is, how it is cut into minibatches, and the steps themselves."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING, Protocol

import numpy as np
import torch
from numpy.typing import NDArray

if TYPE_CHECKING:
    from transferkit.config import PPOConfig
    from transferkit.envs import Count, Step
    from transferkit.run import Session
    from transferkit.trainers.ppo.algorithm import PPO

LONGEST, LONGEST_SHARE = 2048, 0.05
"""Steps, and share of the budget, after which an adaptive rollout waits no more for the end of an episode."""

MOST_MINIBATCHES = 8
"""Gradient steps of a pass over an adaptive rollout."""


@dataclass(frozen=True)
class RolloutRule:
    """When a rollout ends, and its minibatches."""

    config: PPOConfig
    num_envs: int

    @property
    def capacity(self) -> int:
        """The most steps of each environment in a rollout."""
        steps = self.config.rollout_steps
        return (max(steps, LONGEST) if self.config.rollout == "adaptive" else steps) // self.num_envs

    def is_over(self, steps: int, *, ended: bool, share: float) -> bool:
        """Decide whether to update after this many steps and this share of the budget, in which an episode ended or not."""
        if self.config.rollout == "adaptive":
            enough = steps >= self.config.rollout_steps and share >= self.config.least_share
            return enough and (ended or share >= LONGEST_SHARE)
        return ended and self.config.rollout == "episode"

    def minibatch_sizes(self, steps: int) -> list[int]:
        """Return the samples of each gradient step of a pass over a rollout of this many steps."""
        size = self.config.batch_size
        if self.config.rollout == "adaptive":
            count = min(MOST_MINIBATCHES, max(1, steps // size))
            return [steps // count + (k < steps % count) for k in range(count)]
        return [min(size, steps - start) for start in range(0, steps, size)]


class Steppable(Protocol):
    """Environments side by side, real or imagined."""

    num_envs: int

    def step(self, actions: NDArray[np.float32], count: Count | None = None, /) -> Step:
        """Step them all, or the first of them."""
        ...


@torch.no_grad()
def collect(
    algorithm: PPO, envs: Steppable, observation: NDArray[np.float32], rule: RolloutRule, session: Session | None = None
) -> NDArray[np.float32]:
    """Fill the storage with a rollout; returns the observations after it, `(num_envs, obs_dim)`.

    With a session the steps count against its budget, and the rollout is shorter if that ends.
    """
    storage = algorithm.storage
    ended, before = False, session.progress if session else 0.0
    for _ in range(storage.num_transitions_per_env):
        action = algorithm.sample(torch.from_numpy(observation).to(algorithm.device))
        step = envs.step(action.cpu().numpy(), session and session.count)
        if len(step.reward) < envs.num_envs:  # the budget ended between two environments
            break
        algorithm.process_step(step)
        observation, ended = step.observation, ended or bool(step.done.any())
        progress = session.progress if session else 0.0
        if progress >= 1 or rule.is_over(storage.step * envs.num_envs, ended=ended, share=progress - before):
            break
    return observation
