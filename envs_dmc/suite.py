"""One dm_control suite task through Shimmy: flat float32 observation in dm_control's own order, clipped actions.

Mended here, against Shimmy 2.0.1: the observation's order (Gymnasium sorts a Dict's keys when it flattens it), 0-d
entries, float64, the missing episode limit, unclipped actions, a reward that is sometimes an int, a frame rate that is
wrong and shared by the class, unlimited actuators whose bounds are +-1e10, `lqr`, whose model is another one at every
load, and `quadruped-escape`, which asks for an OpenGL context at every reset.
"""

from __future__ import annotations

from typing import Any

import gymnasium
import numpy as np
from gymnasium.envs.registration import EnvSpec
from numpy.typing import NDArray

from envs_dmc.opengl import no_opengl, open_renderer

with no_opengl():
    from dm_control import suite
    from shimmy.dm_control_compatibility import DmControlCompatibilityV0

EPISODE_LIMIT = 1000
"""Control steps; the suite's own limit. Its two `lqr` tasks have none and get the same one here."""

MODEL_SEED = 0
"""The `lqr` tasks draw stiffness and damping when they are loaded; a fixed draw makes their id name one system."""

UNLIMITED = 1e9
"""dm_control writes +-1e10 for an actuator without a control range; such an action is left in its own unit, +-1."""

_PREFIX, _SUFFIX = "dm_control/", "-v0"


def task_ids() -> list[str]:
    """The id of every task of the suite, as Shimmy registers them."""
    return [f"{_PREFIX}{domain}-{task}{_SUFFIX}" for domain, task in suite.ALL_TASKS]


def make(env_id: str, render_mode: str | None = None) -> gymnasium.Env[NDArray[np.float32], NDArray[np.float32]]:
    """The task named by `dm_control/<domain>-<task>-v0`, with its time limit.

    Raises:
        ValueError: the suite has no such task.
    """
    domain, _, task = env_id.removeprefix(_PREFIX).removesuffix(_SUFFIX).partition("-")
    return SuiteTask(domain, task, render_mode=render_mode)


class SuiteTask(gymnasium.Env):
    """A `dm_control.suite` task as a Gymnasium environment.

    The episode ends by `truncated` at `EPISODE_LIMIT` steps and by `terminated` where the task sets the discount to 0.
    """

    metadata: dict[str, Any] = {"render_modes": ["rgb_array"]}  # noqa: RUF012 - Gymnasium's own declaration

    def __init__(self, domain: str, task: str, *, render_mode: str | None = None) -> None:
        native = suite.load(domain, task, task_kwargs={"random": MODEL_SEED})
        if render_mode is None:
            without_rendering(native.physics)
        else:
            open_renderer()
        self.shimmy = DmControlCompatibilityV0(native, render_mode=render_mode)
        self.render_mode = render_mode
        self.dm_env = self.shimmy._env  # noqa: SLF001 - the wrapper offers no accessor
        self.dt = float(self.dm_env.control_timestep())
        self.metadata = self.metadata | {"render_fps": round(1 / self.dt)}
        self.episode_limit = EPISODE_LIMIT
        self._elapsed = 0
        size = sum(int(np.prod(spec.shape)) for spec in self.dm_env.observation_spec().values())
        self.observation_space = gymnasium.spaces.Box(-np.inf, np.inf, (size,), np.float32)
        spec = self.dm_env.action_spec()
        low = np.where(spec.minimum < -UNLIMITED, -1.0, spec.minimum)
        high = np.where(spec.maximum > UNLIMITED, 1.0, spec.maximum)
        self.action_space = gymnasium.spaces.Box(low, high, dtype=np.float64)
        self._low, self._high = low, high
        self.spec = EnvSpec(
            f"{_PREFIX}{domain}-{task}{_SUFFIX}",
            "envs_dmc.suite:SuiteTask",
            max_episode_steps=EPISODE_LIMIT,
            disable_env_checker=True,
            kwargs={"domain": domain, "task": task},
        )

    @property
    def physics(self) -> Any:  # noqa: ANN401 - a class built by dm_control at run time
        """The dm_control physics, with its MuJoCo model and data."""
        return self.dm_env.physics

    def get_observation(self) -> NDArray[np.float32]:
        """The observation of the present physics state, `(obs_dim,)`."""
        return _flatten(self.dm_env.task.get_observation(self.physics))

    def observation_keys(self) -> list[str]:
        """For each element of the observation the dm_control key it comes from."""
        spec = self.dm_env.observation_spec()
        return [key for key, value in spec.items() for _ in range(int(np.prod(value.shape)))]

    def reset(
        self, *, seed: int | None = None, options: dict[str, Any] | None = None
    ) -> tuple[NDArray[np.float32], dict[str, Any]]:
        """Start an episode; with a seed, the one that the suite starts from `random=seed`."""
        self._elapsed = 0
        observation, _ = self.shimmy.reset(seed=seed, options=options)
        return _flatten(observation), {}

    def step(self, action: NDArray[np.floating]) -> tuple[NDArray[np.float32], float, bool, bool, dict[str, Any]]:
        """Advance one control step; the action is clipped to the actuator bounds."""
        clipped = np.clip(np.asarray(action, np.float64), self._low, self._high)
        observation, reward, terminated, truncated, _ = self.shimmy.step(clipped)
        self._elapsed += 1
        truncated = truncated or (not terminated and self._elapsed >= self.episode_limit)
        return _flatten(observation), float(reward), terminated, truncated, {}

    def render(self) -> NDArray[np.uint8] | None:
        """An RGB picture `(height, width, 3)` in render mode `rgb_array`."""
        return self.shimmy.render()

    def close(self) -> None:
        """Free the physics."""
        self.shimmy.close()


def without_rendering(physics: Any) -> None:  # noqa: ANN401
    """Make the physics say that it has no rendering contexts, instead of creating them when asked."""
    physics.__class__ = type(type(physics).__name__, (type(physics),), {"contexts": None})


def _flatten(observation: dict[str, Any]) -> NDArray[np.float32]:
    return np.concatenate([np.ravel(value) for value in observation.values()]).astype(np.float32)
