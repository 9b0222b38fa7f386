"""Evaluation: deterministic actions, seeds of its own, returns with an interval."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Protocol

import gymnasium
import numpy as np
from numpy.typing import NDArray

from transferkit import stats
from transferkit.envs.make import NO_LIMIT, make_env
from transferkit.run.streams import Streams

EPISODES = 20
"""Default episodes of an evaluation."""

POOL = 10
"""Environments stepped side by side at most."""


class Actor(Protocol):
    """Anything that maps observations `(B, obs_dim)` to deterministic actions `(B, act_dim)`."""

    def act(self, observation: NDArray[np.float32]) -> NDArray[np.float32]:
        """The actions."""
        ...


@dataclass(frozen=True)
class Evaluation:
    """Returns and lengths of evaluation episodes, in the order of their seeds."""

    returns: tuple[float, ...]
    lengths: tuple[int, ...]

    @property
    def mean(self) -> float:
        """Mean return."""
        return float(np.mean(self.returns))

    def row(self) -> dict[str, float]:
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
    """Doing nothing: the reference any trained policy has to beat."""

    act_dim: int

    def act(self, observation: NDArray[np.float32]) -> NDArray[np.float32]:
        """Zeros `(B, act_dim)`."""
        return np.zeros((len(observation), self.act_dim), np.float32)


class RandomPolicy:
    """Uniform actions in [-1, 1]."""

    def __init__(self, act_dim: int, seed: int = 0) -> None:
        self.act_dim, self._generator = act_dim, Streams(seed).numpy("random policy")

    def act(self, observation: NDArray[np.float32]) -> NDArray[np.float32]:
        """Uniform draws `(B, act_dim)`."""
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
    """
    streams = Streams(seed)
    make = (lambda: make_env(env, clip_actions=clip_actions)) if isinstance(env, str) else (lambda: make_env(env()))
    pool = [make() for _ in range(min(POOL, episodes))]
    returns, lengths = np.zeros(episodes), np.zeros(episodes, int)
    playing = dict(enumerate(pool))  # episode -> environment
    observations = {k: env.reset(seed=streams.integer("evaluation", k))[0] for k, env in playing.items()}
    following = len(pool)
    while playing:
        actions = policy.act(np.stack([observations[k] for k in playing]))
        for (k, env_k), action in zip(list(playing.items()), actions, strict=True):
            observations[k], reward, terminated, truncated, _ = env_k.step(action)
            returns[k] += float(reward)
            lengths[k] += 1
            if terminated or truncated or lengths[k] >= NO_LIMIT:
                del playing[k]
                if following < episodes:
                    playing[following] = env_k
                    observations[following] = env_k.reset(seed=streams.integer("evaluation", following))[0]
                    following += 1
    for env_k in pool:
        env_k.close()
    return Evaluation(tuple(returns.tolist()), tuple(lengths.tolist()))
