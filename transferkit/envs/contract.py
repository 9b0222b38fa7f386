"""The contract that every environment is put under, and that it is held to in every step."""

from __future__ import annotations

import functools
import logging
import math
from numbers import Integral
from typing import Any

import gymnasium
import numpy as np
from gymnasium.spaces import Box
from gymnasium.wrappers import TimeLimit
from numpy.typing import NDArray

from transferkit.envs.broken import failed
from transferkit.envs.layers import bounds, layers_of
from transferkit.envs.names import name_of
from transferkit.errors import EnvironmentContractError, NotFiniteError, TransferkitError

LOGGER = logging.getLogger("transferkit")

LARGEST = 1e300
"""Absolute value that no return reaches."""

NO_LIMIT = 10_000
"""Steps after which an episode of an environment without a time limit is truncated."""


GYMNASIUM = "gymnasium.envs.mujoco"
"""Module of the robots that take actions of any type; they get float64, of more digits than their spaces, as ever."""

LARGEST_REWARD = 1e30
"""Absolute value of a reward beyond which sums of them, which are float32, and their squares are no numbers."""

NUMBERS, FLAGS = "fiub", "biu"
"""NumPy's kinds of what may be a reward, and of what may say that an episode is over."""

RESET = ("observation", "info")
STEP = ("observation", "reward", "terminated", "truncated", "info")
"""What Gymnasium's environments return."""


class Contract(gymnasium.Wrapper):
    """Float32 observations, and actions in [-1, 1] that are clipped and then scaled to the wrapped environment's bounds.

    What the environment returns is checked in every step, and an episode that never ends is truncated. Gymnasium's
    `RescaleAction` does not clip and its `ClipAction` declares an infinite space, so neither states [-1, 1].
    """

    def __init__(self, env: gymnasium.Env, *, clip: bool = True, max_episode_steps: int | None = None) -> None:
        super().__init__(env)
        actions, observations = bounds(env), env.observation_space
        assert isinstance(actions, Box)
        assert isinstance(observations, Box)
        self.action_space = Box(-1.0, 1.0, actions.shape, np.float32)
        self.observation_space = Box(-np.inf, np.inf, observations.shape, np.float32)
        self.low, self.high = actions.low.astype(np.float64), actions.high.astype(np.float64)
        self._centre, self._half_range = (self.low + self.high) / 2, (self.high - self.low) / 2
        self._dtype = np.dtype(np.float64) if type(env.unwrapped).__module__.startswith(GYMNASIUM) else actions.dtype
        self._whole = np.issubdtype(self._dtype, np.integer)
        self.clip, self._limit = clip, 1.0 if clip else np.inf
        self._most = max_episode_steps or (NO_LIMIT if episode_limit(env) is None else math.inf)
        self.max_episode_steps = max_episode_steps
        self._steps = 0

    def reset(
        self, *, seed: int | None = None, options: dict[str, Any] | None = None
    ) -> tuple[NDArray[np.float32], dict[str, Any]]:
        """Start an episode.

        Raises:
            EnvironmentContractError: the environment raises, or returns something else than an observation and an info.
            NotFiniteError: the observation has NaN or an infinite number.
        """
        self._steps = 0
        try:
            observation, info = self._answer(self.env.reset(seed=seed, options=options), "reset", RESET)
            observation = _as_float32(observation)
        except (Exception, SystemExit) as error:
            raise self._broken(error, "reset") from error
        self._check(observation, 0.0, info)
        return observation, info

    def step(self, action: NDArray[np.floating]) -> tuple[NDArray[np.float32], float, bool, bool, dict[str, Any]]:
        """Advance one control step.

        Raises:
            EnvironmentContractError: the environment raises, or returns other types or shapes than it declares.
            NotFiniteError: the action, the observation or the reward has NaN or an infinite number.
        """
        if not math.isfinite(action.sum(dtype=np.float64)):
            raise self._not_finite("the policy chose an action")
        scaled = self.scaled(action)
        self._steps += 1
        try:
            own = np.rint(scaled) if self._whole else scaled
            observation, reward, terminated, truncated, info = self._answer(
                self.env.step(own.astype(self._dtype, copy=False)), "step", STEP
            )
            observation = _as_float32(observation)
            reward = self._number(reward, "reward", NUMBERS)
            terminated = bool(self._number(terminated, "terminated", FLAGS))
            truncated = bool(self._number(truncated, "truncated", FLAGS))
        except (Exception, SystemExit) as error:
            raise self._broken(error, f"step {self._steps}") from error
        self._check(observation, reward, info)
        if self._steps >= self._most and not terminated and not truncated:
            truncated = True
            if self.max_episode_steps is None:
                _say_given_up(name_of(self.env))
        return observation, reward, terminated, truncated, info

    def scaled(self, action: NDArray[np.floating]) -> NDArray[np.float64]:
        """Put actions `(..., act_dim)` into the wrapped environment's own units, as `step` hands them on."""
        clipped = np.minimum(np.maximum(action, -self._limit), self._limit)  # a fifth of np.clip's time
        scaled = self._centre + self._half_range * clipped
        return np.minimum(np.maximum(scaled, self.low), self.high) if self.clip else scaled  # rounding may leave the bounds

    def close(self) -> None:
        """Close the environment."""
        try:
            self.env.close()
        except (Exception, SystemExit) as error:
            raise self._broken(error, "close") from error

    def _answer(self, answer: Any, call: str, wanted: tuple[str, ...]) -> Any:  # noqa: ANN401 - of somebody else's code
        if not isinstance(answer, tuple) or len(answer) != len(wanted):
            count = len(answer) if isinstance(answer, tuple) else f"a value of type {type(answer).__name__}"
            raise EnvironmentContractError(
                f"{call} of {name_of(self.env)} returned {count} and not {len(wanted)} values: {', '.join(wanted)}",
                topic="own environments",
            )
        return answer

    def _number(self, value: Any, what: str, kinds: str) -> float:  # noqa: ANN401 - of somebody else's code
        """A number that an environment returned, of NumPy's kinds of numbers."""
        if isinstance(value, str) and kinds == NUMBERS:
            float(value)  # which says why it is none
        kind = np.asarray(value)
        if kind.shape or kind.dtype.kind not in kinds:
            found = f"an array of shape {kind.shape}" if kind.shape else f"a value of type {type(value).__name__}"
            wanted = "a number" if kinds == NUMBERS else "True or False"
            raise EnvironmentContractError(
                f"environment {name_of(self.env)} returned {found} for {what}, and not {wanted}", topic="own environments"
            )
        return float(kind)

    def _check(self, observation: NDArray[np.float32], reward: float, info: object) -> None:
        if observation.shape != self.observation_space.shape or not isinstance(info, dict):
            returned = f"an observation of shape {observation.shape} and info of type {type(info).__name__}"
            raise EnvironmentContractError(
                f"environment {name_of(self.env)} returned {returned}, not {self.observation_space.shape} and dict",
                topic="own environments",
            )
        # A float64 sum of float32 values overflows on nothing finite, at half the time of np.isfinite.
        if not math.isfinite(observation.sum(dtype=np.float64) + reward):
            raise self._not_finite(f"environment {name_of(self.env)} returned an observation or a reward")
        if abs(reward) > LARGEST_REWARD:
            raise NotFiniteError(
                f"environment {name_of(self.env)} returned the reward {reward:g} in step {self._steps} of an episode, "
                f"beyond {LARGEST_REWARD:g}",
                remedy="scale its rewards",
            )

    def _not_finite(self, what: str) -> NotFiniteError:
        return NotFiniteError(
            f"{what} with NaN or infinity in step {self._steps} of an episode",
            remedy="check the environment, or lower the learning rate",
        )

    def _broken(self, error: BaseException, where: str) -> TransferkitError:
        return error if isinstance(error, TransferkitError) else failed(name_of(self.env), where, error)


def _as_float32(observation: Any) -> NDArray[np.float32]:  # noqa: ANN401 - of somebody else's code
    if np.iscomplexobj(observation):
        raise TypeError("an observation of complex numbers")
    with np.errstate(over="ignore"):  # infinity is said in words
        return np.array(observation, np.float32)


@functools.cache
def _say_given_up(env: str) -> None:
    LOGGER.warning(
        "%s has no time limit: an episode is truncated after %d steps; env_config.max_episode_steps sets another", env, NO_LIMIT
    )


def dims(env: gymnasium.Env) -> tuple[int, int]:
    """Lengths of the observation and of the action of an environment under the contract."""
    observations, actions = env.observation_space.shape, env.action_space.shape
    assert observations is not None
    assert actions is not None
    return observations[0], actions[0]


def episode_limit(env: gymnasium.Env) -> int | None:
    """Control steps until the environment truncates; None if it never does."""
    given = [env.max_episode_steps] if isinstance(env, Contract) else []
    given.append(getattr(env.unwrapped, "episode_limit", None) if env.spec is None else env.spec.max_episode_steps)
    limited = [layer.spec for layer in layers_of(env) if isinstance(layer, TimeLimit)]
    given += [spec.max_episode_steps for spec in limited if spec is not None]
    limits = [limit for limit in given if limit is not None]
    for limit in limits:
        if not isinstance(limit, Integral) or limit < 1:
            raise EnvironmentContractError(
                f"the episode limit of {name_of(env)}",
                value=limit if isinstance(limit, int | float | str) else type(limit).__name__,
                allowed="a whole number of steps, at least 1",
            )
    return min(map(int, limits), default=None)


def solved_return(env: gymnasium.Env) -> float | None:
    """Return at which the task counts as solved, Gymnasium's `reward_threshold`; None if the environment names no number."""
    threshold = getattr(env.unwrapped.spec, "reward_threshold", None)
    if isinstance(threshold, int | float | np.number) and -LARGEST < threshold < LARGEST:
        return float(threshold)
    if threshold is not None:
        text = repr(threshold)[:40]
        LOGGER.warning("what solves %s is not known: its reward_threshold is %s and no number", name_of(env), text)
    return None


def time_step(env: gymnasium.Env) -> float:
    """Seconds of simulated time per step; 0.0 if the environment does not say."""
    return float(getattr(env.unwrapped, "dt", 0.0))
