"""Experience replay, one row a transition, so that a step's batches are one gather."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np
import torch
from numpy.typing import NDArray
from torch import Tensor

if TYPE_CHECKING:
    from transferkit.envs import Step

FIRST_CAPACITY = 1024
"""Rows allocated at first; doubled when they are full."""


class Batch(NamedTuple):
    """Transitions; the leading axes are free."""

    observation: Tensor
    """`(..., obs_dim)`."""
    action: Tensor
    """`(..., act_dim)`."""
    reward: Tensor
    """`(...)`."""
    next_observation: Tensor
    """`(..., obs_dim)`, the true one if an episode ended."""
    terminated: Tensor
    """`(...)`, 1.0 if nothing follows; a time-out is 0.0."""

    def rows(self) -> Tensor:
        """Join the fields in their order, `(..., width)`."""
        return torch.cat(
            (self.observation, self.action, self.reward.unsqueeze(-1), self.next_observation, self.terminated.unsqueeze(-1)), -1
        )


class ReplayBuffer:
    """The last `capacity` transitions, oldest overwritten first."""

    def __init__(self, obs_dim: int, act_dim: int, capacity: int, device: torch.device | str = "cpu") -> None:
        self.obs_dim, self.act_dim, self.capacity = obs_dim, act_dim, capacity
        self.added = 0
        self._rows = torch.zeros(min(FIRST_CAPACITY, capacity), 2 * obs_dim + act_dim + 2, device=device)
        self._weights = torch.ones(len(self._rows), dtype=torch.float64, device=device)

    def __len__(self) -> int:
        return min(self.added, self.capacity)

    def add(self, batch: Batch, weight: float = 1.0) -> None:
        """Add one transition, without leading axes."""
        self._allocate(self.added + 1)
        at = self.added % self.capacity
        self._rows[at], self._weights[at] = batch.rows(), weight
        self.added += 1

    def extend(self, batch: Batch, weights: Tensor | None = None) -> None:
        """Add transitions `(N, ...)` in their order, with weights `(N,)` or of one; the newest if they are more than fit."""
        rows = batch.rows()[-self.capacity :].to(self._rows.device)
        self._allocate(self.added + len(rows))
        at = torch.arange(self.added, self.added + len(rows), device=self._rows.device) % self.capacity
        self._rows[at] = rows
        self._weights[at] = 1.0 if weights is None else weights[-self.capacity :].to(self._weights)
        self.added += len(rows)

    def add_step(self, observation: NDArray[np.float32], action: NDArray[np.float32], step: Step, weight: float = 1.0) -> None:
        """Add a step of a single environment, all with a leading axis of one."""
        fields = observation, action, step.reward, step.final_observation, step.terminated.astype(np.float32)
        self.add(Batch(*(torch.from_numpy(field)[0].to(self._rows.device) for field in fields)), weight)

    def sample(self, shape: tuple[int, ...], generator: torch.Generator, weighted: float = 0.0) -> Tensor:
        """Draw rows `(*shape, width)` with replacement, this share of them by their weights."""
        options = {"generator": generator, "device": self._rows.device}
        index = torch.randint(len(self), shape, **options)
        if weighted:
            mass = self._weights[: len(self)].cumsum(0)
            drawn = torch.searchsorted(mass, torch.rand(shape, **options).double() * mass[-1]).clamp_(max=len(self) - 1)
            index = torch.where(torch.rand(shape, **options) < weighted, drawn, index)
        return self._rows[index]

    def recent(self, n: int) -> Batch:
        """Return the last `n` transitions in the order of time, `(n, ...)`."""
        index = torch.arange(self.added - min(n, len(self)), self.added, device=self._rows.device) % self.capacity
        return self.split(self._rows[index])

    def all(self) -> Batch:
        """Return every transition, in the order of storage."""
        return self.split(self._rows[: len(self)])

    def split(self, rows: Tensor) -> Batch:
        """Split rows `(..., width)` into a batch of views."""
        observation, action, reward, following, terminated = rows.split((self.obs_dim, self.act_dim, 1, self.obs_dim, 1), -1)
        return Batch(observation, action, reward.squeeze(-1), following, terminated.squeeze(-1))

    def state(self) -> dict[str, Any]:
        """Return the rows, their weights and how many were ever added."""
        return {"added": self.added, "rows": self._rows[: len(self)], "weights": self._weights[: len(self)]}

    def restore(self, state: dict[str, Any]) -> None:
        """Take what `state` returned."""
        n = len(state["rows"])
        if n != min(state["added"], self.capacity):
            raise ValueError(f"{n} rows of {state['added']} that were added, and room for {self.capacity}")
        self.added = state["added"]
        self._allocate(n)
        self._rows[:n], self._weights[:n] = state["rows"], state.get("weights", 1.0)  # earlier versions weighted none

    def _allocate(self, n: int) -> None:
        """Have room for this many rows at least, or for as many as fit."""
        size = len(self._rows)
        while size < min(n, self.capacity):
            size = min(2 * size, self.capacity)
        if more := size - len(self._rows):
            self._rows = torch.cat((self._rows, self._rows.new_zeros(more, self._rows.shape[1])))
            self._weights = torch.cat((self._weights, self._weights.new_ones(more)))
