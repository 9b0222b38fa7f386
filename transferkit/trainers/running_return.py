"""The running deviation of discounted returns, by which rewards are scaled."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import numpy as np
from gymnasium.wrappers.utils import RunningMeanStd
from numpy.typing import NDArray


class RunningReturn:
    """Discounted sums of past rewards in each environment, and the variance of all that were seen.

    As in OpenAI baselines' VecNormalize and gymnasium's NormalizeReward.
    """

    def __init__(self, num_envs: int, discount: float) -> None:
        self.discount = discount
        self._seen = RunningMeanStd(shape=())
        self._running = np.zeros(num_envs)

    def add(self, reward: NDArray[np.float32], done: NDArray[np.bool_]) -> None:
        """Add a step of all environments, `(num_envs,)` each."""
        self._running = self._running * self.discount + reward
        self._seen.update(self._running)
        self._running[done] = 0.0

    @property
    def deviation(self) -> float:
        """Standard deviation of the sums."""
        return float(np.sqrt(self._seen.var + 1e-8))

    def state(self) -> dict[str, Any]:
        """Return plain numbers."""
        seen = self._seen
        return {"returns": [float(seen.mean), float(seen.var), float(seen.count)], "running_return": self._running.tolist()}

    def restore(self, state: Mapping[str, Any]) -> None:
        """Take what `state` returned."""
        self._seen.mean, self._seen.var, self._seen.count = state["returns"]
        self._running = np.array(state["running_return"])
