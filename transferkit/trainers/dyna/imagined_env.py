"""The learnt model as environments side by side, for a trainer that wants to step them."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np
import torch
from numpy.typing import NDArray

from transferkit.envs import Step

if TYPE_CHECKING:
    from transferkit.nn import Dynamics
    from transferkit.trainers.dyna.replay import ReplayBuffer


class ImaginedEnv:
    """Rollouts of the model from replayed observations, truncated after `horizon` steps; stepped like a `VectorEnv`.

    Each rollout follows one member from its start to its end (Chua et al. 2018, TS-infinity).
    """

    def __init__(
        self,
        model: Dynamics,
        buffer: ReplayBuffer,
        num_envs: int,
        *,
        members: int,
        horizon: int,
        generator: torch.Generator,
    ) -> None:
        self.num_envs, self._members = num_envs, members
        self._model, self._buffer, self._horizon, self._generator = model, buffer, horizon, generator

    def reset(self) -> NDArray[np.float32]:
        """Start every rollout anew; observations `(num_envs, obs_dim)`."""
        self._age = torch.zeros(self.num_envs, dtype=torch.int64, device=self._generator.device)
        self._observation, self._member = self._starts()
        return self._observation.cpu().numpy()

    def step(self, actions: NDArray[np.float32], _count: object = None) -> Step:
        """Advance every rollout; those that end or reach the horizon start anew in the same step."""
        device = self._observation.device
        row = torch.arange(self.num_envs, device=device)
        action = torch.from_numpy(actions).to(device).clamp(-1.0, 1.0)
        prediction = self._model.predict(self._observation, action)
        following, reward = prediction.next_observation[self._member, row], prediction.reward[self._member, row]
        terminated = prediction.terminated[self._member, row] > 0.5
        self._age += 1
        truncated = (self._age >= self._horizon) & ~terminated
        ended = terminated | truncated
        starts, members = self._starts()
        self._observation = torch.where(ended.unsqueeze(-1), starts, following)
        self._member = torch.where(ended, members, self._member)
        self._age[ended] = 0
        arrays = (tensor.cpu().numpy() for tensor in (self._observation, reward, terminated, truncated, following))
        return Step(*arrays)

    def _starts(self) -> tuple[torch.Tensor, torch.Tensor]:
        replayed = self._buffer.split(self._buffer.sample((self.num_envs,), self._generator)).observation
        member = torch.randint(self._members, (self.num_envs,), generator=self._generator, device=replayed.device)
        return replayed, member
