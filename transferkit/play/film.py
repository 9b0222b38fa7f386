"""A play as a video."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import closing, contextmanager
from pathlib import Path
from typing import TYPE_CHECKING

import gymnasium
import numpy as np
from numpy.typing import NDArray

from transferkit.play.camera import Camera
from transferkit.play.curves import Curves
from transferkit.record.video import video

if TYPE_CHECKING:
    from transferkit.play.moment import Inputs, Moment, Show

LEAST_HEIGHT = 240
"""Pixels that curves need; a smaller picture is magnified."""


@contextmanager
def film(path: Path, env: gymnasium.Env, time_step: float, inputs: Inputs | None) -> Iterator[Show]:
    """Make a function that adds a moment to a video, with the inputs beside the picture.

    Raises:
        ConfigError: the file cannot be written; nothing of it is left.
    """
    with closing(Camera(env)) as camera:
        picture = _WithCurves(camera, inputs)
        with video(path, time_step, picture.draw, option="out") as add:

            def show(moment: Moment) -> bool:
                add(moment)
                return True

            yield show


class _WithCurves:
    """A picture, and curves on its right."""

    def __init__(self, camera: Camera, inputs: Inputs | None) -> None:
        self._camera, self._inputs = camera, inputs
        self._curves: Curves | None = None

    def draw(self, moment: Moment) -> NDArray[np.uint8]:
        picture = self._camera.picture()
        if self._inputs is None:
            return picture
        times = -(-LEAST_HEIGHT // len(picture))
        picture = picture.repeat(times, 0).repeat(times, 1)
        self._curves = self._curves or Curves(self._inputs, len(picture))
        return np.hstack((picture, self._curves.picture(moment)))
