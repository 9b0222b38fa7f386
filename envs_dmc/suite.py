"""The tasks of dm_control's suite.

Mended here: the two `lqr` tasks have no time limit and another model at every load, and `quadruped-escape` asks for an OpenGL
context at every reset.
"""

from __future__ import annotations

import logging
from typing import Any

import gymnasium
import numpy as np
from gymnasium.envs.registration import EnvSpec
from numpy.typing import NDArray

from envs_dmc.opengl import no_opengl, open_renderer
from envs_dmc.task import DmControlEnv

with no_opengl():
    from dm_control import suite

# Once it is imported, dm_control logs what MuJoCo says at every load of a model, also of Gymnasium's: of deprecated XML too.
logging.getLogger("absl").addFilter(lambda record: "is deprecated" not in record.getMessage())

EPISODE_LIMIT = 1000
"""Control steps; the suite's own limit. Its two `lqr` tasks have none and get the same one here."""

MOST_REWARD = 1.0
"""Of a step; what a suite's task can give at most is that in each (Tassa et al. 2018)."""

MODEL_SEED = 0
"""The `lqr` tasks draw stiffness and damping when they are loaded; a fixed draw makes their id name one system."""

OF_THE_ENVIRONMENT = ("control_timestep", "n_sub_steps")
"""Keyword arguments of `suite.load` that go to the environment; all others go to the task."""

_PREFIX, _SUFFIX = "dm_control/", "-v0"


def task_ids() -> list[str]:
    """The id of every task of the suite, as Shimmy registers them."""
    return [f"{_PREFIX}{domain}-{task}{_SUFFIX}" for domain, task in suite.ALL_TASKS]


def make(
    env_id: str,
    render_mode: str | None = None,
    **kwargs: Any,  # noqa: ANN401
) -> gymnasium.Env[NDArray[np.float32], NDArray[np.float32]]:
    """The task named by `dm_control/<domain>-<task>-v0`, with its time limit.

    Args:
        env_id: of the task.
        render_mode: `rgb_array`, or None.
        **kwargs: of the task, such as `time_limit` in seconds, or of the environment: `control_timestep`, `n_sub_steps`.

    Raises:
        ValueError: the suite has no such task.
        TypeError: the task does not know an argument.
    """
    domain, _, task = env_id.removeprefix(_PREFIX).removesuffix(_SUFFIX).partition("-")
    return SuiteTask(domain, task, render_mode=render_mode, **kwargs)


class SuiteTask(DmControlEnv):
    """A `dm_control.suite` task as a Gymnasium environment."""

    def __init__(self, domain: str, task: str, *, render_mode: str | None = None, **kwargs: Any) -> None:  # noqa: ANN401
        given = dict(kwargs)
        of_env = {name: kwargs.pop(name) for name in OF_THE_ENVIRONMENT if name in kwargs}
        native = suite.load(domain, task, {"random": MODEL_SEED} | kwargs, of_env or None)
        if render_mode is None:
            without_rendering(native.physics)
        else:
            open_renderer()
        super().__init__(native, render_mode=render_mode)
        if self.episode_limit is None:
            self.episode_limit = EPISODE_LIMIT
        self.spec = EnvSpec(
            f"{_PREFIX}{domain}-{task}{_SUFFIX}",
            "envs_dmc.suite:SuiteTask",
            max_episode_steps=self.episode_limit,
            reward_threshold=self.episode_limit * MOST_REWARD,
            disable_env_checker=True,
            kwargs={"domain": domain, "task": task} | given,
        )


def without_rendering(physics: Any) -> None:  # noqa: ANN401
    """Make the physics say that it has no rendering contexts, instead of creating them when asked."""
    physics.__class__ = type(type(physics).__name__, (type(physics),), {"contexts": None})
