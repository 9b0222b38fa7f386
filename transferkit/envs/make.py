"""`make_env`: any supported environment under one contract.

One flat float32 observation, actions in [-1, 1] that are clipped and scaled to the actuator bounds, terminated and
truncated apart, `reset(seed=)` deterministic.
"""

from __future__ import annotations

from typing import Any

import gymnasium
import numpy as np
from gymnasium.spaces import Box
from numpy.typing import NDArray

from transferkit.errors import EnvironmentContractError, UnknownNameError
from transferkit.renderer import choose_renderer

Env = gymnasium.Env[NDArray[np.float32], NDArray[np.float32]]

DM_CONTROL_PREFIX = "dm_control/"
NO_LIMIT = 100_000
"""Steps after which an episode of an environment without a time limit is given up."""


def environment_ids() -> list[str]:
    """Every environment that is tested by id: Gymnasium's MuJoCo v5 tasks and the dm_control suite."""
    import envs_dmc  # noqa: PLC0415 - takes seconds to import

    v5 = [
        env_id
        for env_id, spec in gymnasium.registry.items()
        if str(spec.entry_point).startswith("gymnasium.envs.mujoco") and spec.version == 5
    ]
    return sorted(v5) + sorted(envs_dmc.task_ids())


def make_env(env: str | gymnasium.Env, *, render_mode: str | None = None, clip_actions: bool = True) -> Env:
    """Put an environment under transferkit's contract.

    Args:
        env: an id of Gymnasium's registry, `dm_control/<domain>-<task>-v0`, or an environment of your own.
        render_mode: handed to the environment when it is made from an id.
        clip_actions: False lets actions beyond [-1, 1] reach the environment, as in the paper's code.

    Raises:
        UnknownNameError: no environment has this id.
        EnvironmentContractError: a discrete, image or nested space, unbounded actions, or nothing can be rendered here.
    """
    if render_mode is not None:
        choose_renderer()
    raw = _from_id(env, render_mode) if isinstance(env, str) else env
    if isinstance(raw, Contract):
        return raw if clip_actions or not raw.clip else Contract(raw.env, clip=False)
    name = env if isinstance(env, str) else _name(raw)
    for what, space, bounded in (("action", raw.action_space, True), ("observation", raw.observation_space, False)):
        if not isinstance(space, Box) or len(space.shape) != 1 or (bounded and not space.is_bounded()):
            raise EnvironmentContractError(
                f"{what} space of {name}",
                value=space,
                allowed=f"a flat{' and bounded' * bounded} Box",
                topic="environments",
            )
    return Contract(raw, clip=clip_actions)


class Contract(gymnasium.Wrapper):
    """Float32 observations, and actions in [-1, 1] that are clipped and then scaled to the wrapped environment's bounds.

    Gymnasium's `RescaleAction` does not clip and its `ClipAction` declares an infinite space, so neither states [-1, 1].
    """

    def __init__(self, env: gymnasium.Env, *, clip: bool = True) -> None:
        super().__init__(env)
        actions, observations = env.action_space, env.observation_space
        assert isinstance(actions, Box)
        assert isinstance(observations, Box)
        self.action_space = Box(-1.0, 1.0, actions.shape, np.float32)
        self.observation_space = Box(-np.inf, np.inf, observations.shape, np.float32)
        low, high = actions.low.astype(np.float64), actions.high.astype(np.float64)
        self._centre, self._half_range = (low + high) / 2, (high - low) / 2
        self.clip, self._limit = clip, 1.0 if clip else np.inf

    def reset(
        self, *, seed: int | None = None, options: dict[str, Any] | None = None
    ) -> tuple[NDArray[np.float32], dict[str, Any]]:
        """Start an episode."""
        observation, info = self.env.reset(seed=seed, options=options)
        return np.array(observation, np.float32), info

    def step(self, action: NDArray[np.floating]) -> tuple[NDArray[np.float32], float, bool, bool, dict[str, Any]]:
        """Advance one control step."""
        clipped = np.minimum(np.maximum(action, -self._limit), self._limit)  # a fifth of np.clip's time
        observation, reward, terminated, truncated, info = self.env.step(self._centre + self._half_range * clipped)
        return np.array(observation, np.float32), float(reward), bool(terminated), bool(truncated), info


def dims(env: gymnasium.Env) -> tuple[int, int]:
    """Lengths of the observation and of the action of an environment under the contract."""
    observations, actions = env.observation_space.shape, env.action_space.shape
    assert observations is not None
    assert actions is not None
    return observations[0], actions[0]


def episode_limit(env: gymnasium.Env) -> int | None:
    """Control steps until the environment truncates; None if it never does."""
    if env.spec is not None and env.spec.max_episode_steps is not None:
        return env.spec.max_episode_steps
    return getattr(env.unwrapped, "episode_limit", None)


def time_step(env: gymnasium.Env) -> float:
    """Seconds of simulated time per step; 0.0 if the environment does not say."""
    return float(getattr(env.unwrapped, "dt", 0.0))


def _from_id(env_id: str, render_mode: str | None) -> gymnasium.Env:
    if env_id.startswith(DM_CONTROL_PREFIX):
        return _from_suite(env_id, render_mode)
    kwargs: dict[str, Any] = {} if render_mode is None else {"render_mode": render_mode}
    try:
        return gymnasium.make(env_id, disable_env_checker=True, **kwargs)
    except (gymnasium.error.UnregisteredEnv, gymnasium.error.NameNotFound):
        raise UnknownNameError("environment", env_id, environment_ids(), topic="environments") from None
    except (gymnasium.error.Error, ImportError) as error:
        reason = str(error).splitlines()[0]
        raise EnvironmentContractError(f"environment {env_id} cannot be made: {reason}", topic="environments") from error


def _from_suite(env_id: str, render_mode: str | None) -> gymnasium.Env:
    import envs_dmc  # noqa: PLC0415 - takes seconds to import

    if env_id not in envs_dmc.task_ids():
        raise UnknownNameError("environment", env_id, environment_ids(), topic="environments")
    return envs_dmc.make(env_id, render_mode)


def _name(env: gymnasium.Env) -> str:
    return env.spec.id if env.spec is not None else type(env.unwrapped).__name__
