"""The training loop of PPO."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from typing import Any, Protocol, cast

import numpy as np
import torch
from numpy.typing import NDArray
from torch import nn

from transferkit.config import PPOConfig
from transferkit.envs.vector import Step, VectorEnv
from transferkit.policy.base import Policy
from transferkit.ppo.algorithm import PPO
from transferkit.run.session import Session
from transferkit.run.streams import Streams


class Steppable(Protocol):
    """Environments side by side, real or imagined."""

    num_envs: int

    def step(self, actions: NDArray[np.float32], count: Callable[[int, float, bool, bool], bool] | None = None, /) -> Step:
        """Step them all, or the first of them."""
        ...


def train(
    policy: Policy,
    envs: VectorEnv,
    config: PPOConfig,
    session: Session,
    streams: Streams,
    device: torch.device,
    resume_from: Mapping[str, Any] | None = None,
) -> dict[str, nn.Module]:
    """Train the policy in place until the session's budget is reached; returns its critic.

    Raises:
        NotFiniteError: NaN from an environment or in a loss.
        Interrupted: a signal came; the state is on disk.
    """
    algorithm = PPO(policy.to(device), config, streams, device)
    algorithm.train_mode()
    if resume_from is None:
        observation = envs.reset()
    else:
        algorithm.restore(dict(resume_from["algorithm"]))
        observation = envs.restore(resume_from["envs"])
    while session.progress < 1:
        policy.at_progress(session.progress)
        algorithm.set_learning_rate(session.progress, session.spent.episodes)
        observation = collect(algorithm, envs, observation, config, session)
        if session.progress < 1 or algorithm.storage.step * envs.num_envs >= config.batch_size:
            algorithm.compute_returns(_tensor(observation, device))
            metrics = algorithm.update() | {"learning_rate": algorithm.learning_rate}
            session.after_update(metrics, lambda: {"algorithm": algorithm.state(), "envs": envs.state()})
    return {"value": algorithm.critic}


@torch.no_grad()
def collect(
    algorithm: PPO, envs: Steppable, observation: NDArray[np.float32], config: PPOConfig, session: Session | None = None
) -> NDArray[np.float32]:
    """Fill the storage with a rollout as the configuration has it; returns the observations after it, `(num_envs, obs_dim)`.

    With a session the steps count against its budget, and the rollout is shorter where that ends.
    """
    device, storage = algorithm.device, algorithm.storage
    algorithm.set_collecting(now=True)
    ended, before = False, session.progress if session else 0.0
    for _ in range(storage.num_transitions_per_env):
        action = algorithm.act(cast("Any", _tensor(observation, device)))
        step = envs.step(action.cpu().numpy(), session and session.count)
        if len(step.reward) < envs.num_envs:  # the budget ended between two environments
            break
        algorithm.process_step(step)
        observation, ended = step.observation, ended or bool(step.done.any())
        progress = session.progress if session else 0.0
        if progress >= 1 or config.rollout_is_over(storage.step * envs.num_envs, ended=ended, share=progress - before):
            break
    return observation


def _tensor(array: NDArray[Any], device: torch.device | str) -> torch.Tensor:
    return torch.from_numpy(array).to(device)
