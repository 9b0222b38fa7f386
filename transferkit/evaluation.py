"""Evaluation: deterministic actions, seeds of its own, returns with an interval."""

from __future__ import annotations

from collections.abc import Callable
from contextlib import ExitStack
from dataclasses import dataclass
from typing import TYPE_CHECKING, Annotated

import numpy as np
from numpy.typing import NDArray

from transferkit import stats
from transferkit.config.checks import EPISODES, check_value
from transferkit.envs import dims, is_maker, opened, rollout, written
from transferkit.errors import ConfigError, NotFiniteError
from transferkit.streams import Streams

if TYPE_CHECKING:
    from transferkit.envs import Actor, EnvLike

DEFAULT_EPISODES = 20
"""Episodes of an evaluation."""

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

    @property
    def steps(self) -> int:
        """Environment steps that it took."""
        return sum(self.lengths)

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
    env: EnvLike,
    *,
    episodes: int = DEFAULT_EPISODES,
    seed: int = 0,
    clip_actions: bool = True,
    max_episode_steps: int | None = None,
    report: Callable[[int, int], None] | None = None,
) -> Evaluation:
    """Play episodes with the policy's deterministic action.

    Episode k starts from a seed drawn from (seed, k) alone, so that every policy meets the same starts.

    Args:
        policy: has `act`, which answers observations `(B, obs_dim)` with actions `(B, act_dim)` in [-1, 1], whatever the
            environment's bounds.
        env: in any form that `make_env` takes; one that is made plays every episode itself and stays open.
        episodes: how many.
        seed: of the episodes' starts; training never uses these streams.
        clip_actions: as the policy was trained.
        max_episode_steps: truncate episodes here; see `make_env`.
        report: called after every step with the episodes that ended and the steps so far.

    Raises:
        SettingError: less than one episode, or a negative seed.
        ConfigError: the policy does not fit the environment.
        NotFiniteError, EnvironmentContractError: the policy or the environment returned what it must not.
    """
    check_value("episodes", episodes, Annotated[int, EPISODES])
    if not callable(getattr(policy, "act", None)):
        kind = type(policy).__name__
        raise ConfigError(
            f"policy is of type {kind} and cannot act", remedy="make one with wrap, scratch_policy or load_policy"
        )
    streams, options = Streams(seed), {"clip_actions": clip_actions, "max_episode_steps": max_episode_steps}
    returns, lengths, ended = np.zeros(episodes), np.zeros(episodes, int), 0
    with ExitStack() as open_envs:
        size = min(POOL, episodes) if is_maker(env) else 1
        pool = [open_envs.enter_context(opened(env, **options)) for _ in range(size)]
        if fits := getattr(policy, "check_fits", None):  # not every actor is a policy
            fits(dims(pool[0]), env if isinstance(env, str) else written(pool[0].env))
        for steps, step in enumerate(rollout(policy, pool, streams.episode, episodes=episodes), 1):
            returns[step.episode] += step.reward
            lengths[step.episode] += 1
            ended += step.done
            if report is not None:
                report(ended, steps)
    if not np.isfinite(returns).all():
        raise NotFiniteError("the return of an episode is infinite", remedy="check the environment's rewards")
    return Evaluation(tuple(returns.tolist()), tuple(lengths.tolist()))
