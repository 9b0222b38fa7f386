"""Pictures of an environment: MuJoCo's are drawn here, all others draw themselves."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import gymnasium
import numpy as np
from gymnasium.envs.mujoco.mujoco_rendering import MujocoRenderer
from numpy.typing import NDArray

from transferkit.envs import name_of, open_simulation
from transferkit.errors import EnvironmentContractError
from transferkit.physics import mujoco
from transferkit.record.video import frame

if TYPE_CHECKING:
    from transferkit.envs import Simulation

SIZE = 480
"""Pixels of a picture's sides, if the model has room for so many."""


def camera_of(model: mujoco.MjModel) -> int:
    """Choose a camera: the first that follows a body, else the model's first; -1, a free one, if it has none."""
    following = {int(mujoco.mjtCamLight.mjCAMLIGHT_TRACK), int(mujoco.mjtCamLight.mjCAMLIGHT_TRACKCOM)}
    modes = model.cam_mode.tolist()
    return next((k for k, mode in enumerate(modes) if mode in following), 0 if modes else -1)


class Camera:
    """Takes pictures of an environment."""

    def __init__(self, env: gymnasium.Env) -> None:
        self._env, self._simulation = env, open_simulation(env)
        self._renderer: MujocoRenderer | None = None

    def picture(self) -> NDArray[np.uint8]:
        """Take a picture, `(height, width, 3)`.

        Raises:
            EnvironmentContractError: it is not MuJoCo and draws nothing.
        """
        if self._simulation is not None:
            drawn: Any = self._drawing(self._simulation).render("rgb_array")
            return np.asarray(drawn, np.uint8)
        if self._env.render_mode != "rgb_array":
            raise EnvironmentContractError(
                f"{name_of(self._env)} is not a MuJoCo environment, and draws no pictures in render mode rgb_array",
                remedy="play in another {env}",
            )
        return frame(self._env)

    def close(self) -> None:
        """Free the renderer."""
        if self._renderer is not None:
            self._renderer.close()
            self._renderer = None

    def _drawing(self, simulation: Simulation) -> MujocoRenderer:
        """Find what draws the model and data of now, which some environments make anew in every reset."""
        model, data = simulation.model, simulation.data
        if self._renderer is None or self._renderer.model is not model or self._renderer.data is not data:
            self.close()
            own: Any = getattr(self._env.unwrapped, "mujoco_renderer", None)
            view, room = getattr(own, "default_cam_config", None), model.vis.global_
            sides = min(SIZE, room.offwidth), min(SIZE, room.offheight)
            self._renderer = MujocoRenderer(model, data, view, *sides, camera_id=camera_of(model))
        return self._renderer
