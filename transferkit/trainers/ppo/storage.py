"""rsl_rl's rollout storage with a variable length, plain tensors as observations, and a generator of its own."""

from __future__ import annotations

import itertools
from collections.abc import Callable, Iterator, Sequence
from typing import cast

import torch
from rsl_rl.storage import RolloutStorage
from tensordict import TensorDict
from torch import Tensor

from transferkit.trainers.ppo.minibatch import Minibatch


class Storage(RolloutStorage):
    """Rollouts `(T, num_envs, ...)` of at most `capacity` steps; `close` cuts the buffers to what was collected.

    `minibatch_sizes` says how many samples each minibatch has, by how many there are.
    """

    FIELDS = ("observations", "actions", "rewards", "dones", "values", "actions_log_prob", "returns", "advantages")

    def __init__(
        self,
        num_envs: int,
        capacity: int,
        obs_dim: int,
        act_dim: int,
        *,
        minibatch_sizes: Callable[[int], Sequence[int]],
        shuffle: bool,
        generator: torch.Generator,
    ) -> None:
        device = str(generator.device)
        placeholder = TensorDict({"policy": torch.zeros(num_envs, obs_dim)}, [num_envs])
        super().__init__("rl", num_envs, capacity, placeholder, [act_dim], device)
        self.observations = torch.zeros(capacity, num_envs, obs_dim, device=device)
        self.distribution_params = tuple(torch.zeros(capacity, num_envs, act_dim, device=device) for _ in range(2))
        self._minibatch_sizes, self._shuffle, self._generator = minibatch_sizes, shuffle, generator
        self._full = {name: getattr(self, name) for name in self.FIELDS}
        self._full_params, self._capacity = self.distribution_params, capacity

    def close(self) -> None:
        """End the rollout: every buffer becomes a view of the steps that were collected."""
        self.num_transitions_per_env = self.step
        for name, buffer in self._full.items():
            setattr(self, name, buffer[: self.step])
        self.distribution_params = tuple(buffer[: self.step] for buffer in self._full_params)

    def clear(self) -> None:
        """Begin the next rollout with the full buffers."""
        super().clear()
        self.num_transitions_per_env = self._capacity
        for name, buffer in self._full.items():
            setattr(self, name, buffer)
        self.distribution_params = self._full_params

    @property
    def num_mini_batches(self) -> int:
        """Minibatches of a pass over the rollout."""
        return len(self._minibatch_sizes(self.step * self.num_envs))

    def minibatches(self, epochs: int) -> Iterator[Minibatch]:
        """Yield minibatches, permuted anew in every epoch, or in the order of time."""
        named = (getattr(self, name) for name in Minibatch._fields[:-2])
        tensors = *named, *cast("tuple[Tensor, ...]", self.distribution_params)
        flat = [tensor.flatten(0, 1) for tensor in tensors]
        size = len(flat[0])
        ends = list(itertools.accumulate(self._minibatch_sizes(size), initial=0))
        for _ in range(epochs):
            order = torch.randperm(size, generator=self._generator, device=self.device) if self._shuffle else None
            # One gather an epoch; minibatches are then views.
            epoch = flat if order is None else [tensor[order] for tensor in flat]
            for rows in itertools.starmap(slice, itertools.pairwise(ends)):
                yield Minibatch(*(tensor[rows] for tensor in epoch))
