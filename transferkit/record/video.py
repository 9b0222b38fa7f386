"""Video of anything that a picture can be made of."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any, TypeVar

import gymnasium
import imageio_ffmpeg
import numpy as np
from numpy.typing import NDArray

from transferkit.envs import failed, name_of
from transferkit.files import new_file

T = TypeVar("T")

FPS = 30.0
"""The most frames a second of simulated time."""

OPTIONS: Any = {"macro_block_size": 2, "ffmpeg_log_level": "quiet", "output_params": ["-f", "mp4"]}
"""Of ffmpeg, which writes into a file of another ending."""


@contextmanager
def video(
    path: Path, time_step: float, picture: Callable[[T], NDArray[np.uint8]], *, option: str = "video"
) -> Iterator[Callable[[T], None]]:
    """Make a function that adds a frame, at most `FPS` a simulated second.

    Args:
        path: the file.
        time_step: simulated seconds between two calls of the function; 0 if unknown.
        picture: makes a frame, `(height, width, 3)`, of what the function is called with; not for every call.
        option: whose value the path is.

    Raises:
        ConfigError: the file cannot be written; nothing of it is left.
    """
    every = max(1, round(1 / (FPS * time_step))) if time_step else 1
    fps: Any = 1 / (every * time_step) if time_step else FPS  # a float will do
    writer, steps, sent = None, 0, 0

    def add(scene: T) -> None:
        nonlocal writer, steps, sent
        if steps % every == 0:
            drawn = picture(scene)
            if writer is None:
                writer = imageio_ffmpeg.write_frames(str(temporary), drawn.shape[1::-1], fps=fps, **OPTIONS)
                writer.send(None)
            writer.send(drawn.tobytes())
            sent += 1
        steps += 1

    with new_file(path, option) as temporary:
        try:
            yield add
        finally:
            if writer is not None:
                writer.close()
        if _frames(temporary) != sent:
            raise OSError("ffmpeg could not write all of it; is the disk full?")


def frame(env: gymnasium.Env) -> NDArray[np.uint8]:
    """Let an environment in render mode `rgb_array` draw itself, `(height, width, 3)`.

    Raises:
        EnvironmentContractError: it fails.
    """
    try:
        drawn: Any = env.render()  # an array in this mode
        return np.asarray(drawn, np.uint8).reshape(*drawn.shape[:2], 3)
    except Exception as error:  # of an environment of the user's
        raise failed(name_of(env), "render", error) from error


def _frames(path: Path) -> int:
    """Count the frames of a video; ffmpeg's end says nothing of a disk that was full."""
    try:
        return imageio_ffmpeg.count_frames_and_secs(str(path))[0]
    except RuntimeError:
        return -1
