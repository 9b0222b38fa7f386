"""Evaluation: deterministic actions, seeds of its own, returns with an interval."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import TYPE_CHECKING

import gymnasium
import numpy as np
from numpy.typing import NDArray

from transferkit import stats
from transferkit.envs import make_env, rollout
from transferkit.errors import SettingError
from transferkit.streams import Streams

if TYPE_CHECKING:
    from transferkit.envs import Actor

EPISODES = 20
"""Default episodes of an evaluation."""

POOL = 10
"""Most environments stepped side by side."""


@dataclass(frozen=True)
class Evaluation:
    """Returns and lengths of evaluation episodes, in the order of their seeds."""

    returns: tuple[float, ...]
    lengths: tuple[int, ...]

    @property
    def mean(self) -> float:
        """Mean return."""
        return float(np.mean(self.returns))

    def scores(self) -> dict[str, float]:
        """Mean, standard deviation over episodes (n - 1), and Student's 95 % interval of the mean."""
        low, high = stats.mean_interval(self.returns)
        deviation = float(np.std(self.returns, ddof=1)) if len(self.returns) > 1 else 0.0
        return {
            "return_mean": self.mean,
            "return_std": deviation,
            "return_low": low,
            "return_high": high,
            "n": len(self.returns),
        }


@dataclass(frozen=True)
class ZeroPolicy:
    """Doing nothing: the reference that any trained policy has to beat."""

    act_dim: int

    def act(self, observation: NDArray[np.float32]) -> NDArray[np.float32]:
        """Return zeros `(B, act_dim)`."""
        return np.zeros((len(observation), self.act_dim), np.float32)


class RandomPolicy:
    """Uniform actions in [-1, 1]."""

    def __init__(self, act_dim: int, seed: int = 0) -> None:
        self.act_dim, self._generator = act_dim, Streams(seed).numpy("random policy")

    def act(self, observation: NDArray[np.float32]) -> NDArray[np.float32]:
        """Draw actions `(B, act_dim)`."""
        return self._generator.uniform(-1, 1, (len(observation), self.act_dim)).astype(np.float32)


def evaluate(
    policy: Actor,
    env: str | Callable[[], gymnasium.Env],
    *,
    episodes: int = EPISODES,
    seed: int = 0,
    clip_actions: bool = True,
) -> Evaluation:
    """Play episodes with the policy's deterministic action.

    Episode k starts from a seed drawn from (seed, k) alone, so that every policy meets the same starts.

    Args:
        policy: has `act`.
        env: an id, or a function that makes the environment.
        episodes: how many.
        seed: of the episodes' starts; training never uses these streams.
        clip_actions: as the policy was trained.

    Raises:
        SettingError: less than one episode, or a negative seed.
    """
    if episodes < 1:
        raise SettingError("episodes", value=episodes, allowed="at least 1")
    streams = Streams(seed)
    pool = [make_env(env if isinstance(env, str) else env(), clip_actions=clip_actions) for _ in range(min(POOL, episodes))]
    returns, lengths = np.zeros(episodes), np.zeros(episodes, int)
    for step in rollout(policy, pool, lambda episode: streams.integer("evaluation", episode), episodes=episodes):
        returns[step.episode] += step.reward
        lengths[step.episode] += 1
    for env_k in pool:
        env_k.close()
    return Evaluation(tuple(returns.tolist()), tuple(lengths.tolist()))
