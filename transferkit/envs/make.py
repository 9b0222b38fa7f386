"""`make_env`: any supported environment under one contract.

One flat float32 observation, actions in [-1, 1] that are clipped and scaled to the actuator bounds, terminated and
truncated apart, `reset(seed=)` deterministic.
"""

# pyright: reportAttributeAccessIssue=false
# mujoco's names come from compiled modules that pyright cannot read.
from __future__ import annotations

import logging
from typing import Any

import gymnasium
import mujoco
import numpy as np
from gymnasium.spaces import Box
from numpy.typing import NDArray

from transferkit.errors import EnvironmentContractError, UnknownNameError

# MuJoCo's own handler prints to stdout and leaves a MUJOCO_LOG.TXT in the working directory.
mujoco.set_mju_user_warning(logging.getLogger("mujoco").info)

Env = gymnasium.Env[NDArray[np.float32], NDArray[np.float32]]

DM_CONTROL_PREFIX = "dm_control/"
LISTING = "transferkit envs list"
CONTINUOUS = f"transferkit takes flat Box observations and bounded Box actions; `{LISTING}` lists what fits"


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
    """The environment under transferkit's contract.

    Args:
        env: an id of Gymnasium's registry, `dm_control/<domain>-<task>-v0`, or an environment of your own.
        render_mode: handed to the environment when it is made from an id.
        clip_actions: False lets actions beyond [-1, 1] reach the environment, as in the paper's code.

    Raises:
        UnknownNameError: no environment has this id.
        EnvironmentContractError: a discrete, image or nested space, or unbounded actions.
    """
    raw = _from_id(env, render_mode) if isinstance(env, str) else env
    if isinstance(raw, Contract):
        return raw
    name = env if isinstance(env, str) else _name(raw)
    actions, observations = raw.action_space, raw.observation_space
    if not isinstance(actions, Box) or len(actions.shape) != 1:
        raise EnvironmentContractError(f"environment {name} has actions {actions}; {CONTINUOUS}")
    if not isinstance(observations, Box) or len(observations.shape) != 1:
        raise EnvironmentContractError(f"environment {name} has observations {observations}; {CONTINUOUS}")
    if not (np.isfinite(actions.low).all() and np.isfinite(actions.high).all()):
        raise EnvironmentContractError(f"environment {name} has unbounded actions {actions}; {CONTINUOUS}")
    return Contract(raw, clip=clip_actions)


NO_LIMIT = 100_000
"""Steps after which an episode of an environment without a time limit is given up."""


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
        self._limit = 1.0 if clip else np.inf

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


def episode_limit(env: gymnasium.Env) -> int | None:
    """Control steps until the environment truncates; None where it never does."""
    if env.spec is not None and env.spec.max_episode_steps is not None:
        return env.spec.max_episode_steps
    return getattr(env.unwrapped, "episode_limit", None)


def time_step(env: gymnasium.Env) -> float:
    """Seconds of simulated time per step; 0.0 where the environment does not say."""
    return float(getattr(env.unwrapped, "dt", 0.0))


def _from_id(env_id: str, render_mode: str | None) -> gymnasium.Env:
    if env_id.startswith(DM_CONTROL_PREFIX):
        import envs_dmc  # noqa: PLC0415

        if env_id not in envs_dmc.task_ids():
            raise UnknownNameError("environment", env_id, environment_ids(), LISTING)
        return envs_dmc.make(env_id, render_mode)
    kwargs: dict[str, Any] = {} if render_mode is None else {"render_mode": render_mode}
    try:
        return gymnasium.make(env_id, disable_env_checker=True, **kwargs)
    except (gymnasium.error.UnregisteredEnv, gymnasium.error.NameNotFound):
        raise UnknownNameError("environment", env_id, environment_ids(), LISTING) from None
    except (gymnasium.error.Error, ImportError) as error:
        reason = str(error).splitlines()[0]
        raise EnvironmentContractError(f"environment {env_id} cannot be made: {reason}") from error


def _name(env: gymnasium.Env) -> str:
    return env.spec.id if env.spec is not None else type(env.unwrapped).__name__
