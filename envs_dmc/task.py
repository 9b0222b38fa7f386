"""An environment of dm_control's own kind through Shimmy: flat float32 observation in dm_control's order, clipped actions.

Mended here, against Shimmy 2.0.1: the observation's order (Gymnasium sorts a Dict's keys when it flattens it), 0-d
entries, float64, the missing episode limit, unclipped actions, a reward that is sometimes an int, a frame rate that is
wrong and shared by the class, and unlimited actuators whose bounds are +-1e10.
"""

from __future__ import annotations

import math
from typing import Any

import gymnasium
import numpy as np
from numpy.typing import NDArray

from envs_dmc.opengl import no_opengl

with no_opengl():
    from shimmy.dm_control_compatibility import DmControlCompatibilityV0

UNLIMITED = 1e9
"""dm_control writes +-1e10 for an actuator without a control range; such an action is left in its own unit, +-1."""


class DmControlEnv(gymnasium.Env):
    """A `dm_control.rl.control.Environment` or `dm_control.composer.Environment` as a Gymnasium environment.

    The episode ends by `truncated` at its time limit and by `terminated` where the task sets the discount to 0.
    """

    metadata: dict[str, Any] = {"render_modes": ["rgb_array"]}  # noqa: RUF012 - Gymnasium's own declaration

    def __init__(self, native: Any, *, render_mode: str | None = None) -> None:  # noqa: ANN401 - of either kind, or a wrapper
        """Take the environment.

        Raises:
            ValueError: an observation is a picture.
        """
        self.shimmy = DmControlCompatibilityV0(native, render_mode=render_mode)
        self.render_mode, self.dm_env = render_mode, native
        self.dt = float(native.control_timestep())
        self.metadata = self.metadata | {"render_fps": round(1 / self.dt)}
        self.episode_limit = _limit(native, self.dt)
        self._elapsed = 0
        shapes = {name: spec.shape for name, spec in native.observation_spec().items()}
        for name, shape in shapes.items():
            if len(shape) > 2:
                raise ValueError(f"observation {name} of shape {shape} is not flat")
        size = sum(math.prod(shape) for shape in shapes.values())
        self.observation_space = gymnasium.spaces.Box(-np.inf, np.inf, (size,), np.float32)
        spec = native.action_spec()
        low, high = (np.broadcast_to(getattr(spec, end, math.inf), spec.shape) for end in ("minimum", "maximum"))
        self._low = np.where(np.abs(low) > UNLIMITED, -1.0, low)
        self._high = np.where(np.abs(high) > UNLIMITED, 1.0, high)
        self.action_space = gymnasium.spaces.Box(self._low, self._high, dtype=np.float64)

    @property
    def physics(self) -> Any:  # noqa: ANN401 - a class built by dm_control at run time
        """The dm_control physics, with its MuJoCo model and data."""
        return self.dm_env.physics

    def observation_keys(self) -> list[str]:
        """For each element of the observation the dm_control key it comes from."""
        spec = self.dm_env.observation_spec()
        return [key for key, value in spec.items() for _ in range(math.prod(value.shape))]

    def reset(
        self, *, seed: int | None = None, options: dict[str, Any] | None = None
    ) -> tuple[NDArray[np.float32], dict[str, Any]]:
        """Start an episode; with a seed, the one that dm_control starts from `random=seed`."""
        self._elapsed = 0
        observation, _ = self.shimmy.reset(seed=seed, options=options)
        return _flatten(observation), {}

    def step(self, action: NDArray[np.floating]) -> tuple[NDArray[np.float32], float, bool, bool, dict[str, Any]]:
        """Advance one control step; the action is clipped to the actuator bounds."""
        clipped = np.clip(np.asarray(action, np.float64), self._low, self._high)
        observation, reward, terminated, truncated, _ = self.shimmy.step(clipped)
        self._elapsed += 1
        if self.episode_limit is not None and not terminated:
            truncated = truncated or self._elapsed >= self.episode_limit
        return _flatten(observation), float(reward), terminated, truncated, {}

    def render(self) -> NDArray[np.uint8] | None:
        """An RGB picture `(height, width, 3)` in render mode `rgb_array`."""
        return self.shimmy.render()

    def close(self) -> None:
        """Free the physics."""
        self.shimmy.close()


def _limit(native: Any, time_step: float) -> int | None:  # noqa: ANN401
    """Control steps of an episode: dm_control's kinds keep them, or seconds; what wraps them is looked through."""
    while not hasattr(native, "_step_limit") and not hasattr(native, "_time_limit") and hasattr(native, "_env"):
        native = native._env  # noqa: SLF001 - dm_control's wrappers offer no accessor
    limit = getattr(native, "_step_limit", getattr(native, "_time_limit", math.inf) / time_step)
    return None if math.isinf(limit) else round(limit)


def _flatten(observation: dict[str, Any]) -> NDArray[np.float32]:
    return np.concatenate([np.ravel(value) for value in observation.values()]).astype(np.float32)
