"""Video of a replay, through MuJoCo's offscreen renderer."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import TYPE_CHECKING, Any

import gymnasium
import imageio_ffmpeg

if TYPE_CHECKING:
    from transferkit.record.replay import OnFrame

FPS = 30.0
"""The most frames a second of simulated time."""


@contextmanager
def video(path: Path, time_step: float) -> Iterator[OnFrame]:
    """Make a function that adds a frame of an environment in render mode `rgb_array`, at most `FPS` a simulated second."""
    every = max(1, round(1 / (FPS * time_step))) if time_step else 1
    fps: Any = 1 / (every * time_step) if time_step else FPS  # a float will do
    writer, steps = None, 0

    def add(env: gymnasium.Env) -> None:
        nonlocal writer, steps
        if steps % every == 0:
            frame: Any = env.render()  # an array in this mode
            if writer is None:
                size = frame.shape[1], frame.shape[0]
                writer = imageio_ffmpeg.write_frames(str(path), size, fps=fps, macro_block_size=2)
                writer.send(None)
            writer.send(frame.tobytes())
        steps += 1

    try:
        yield add
    finally:
        if writer is not None:
            writer.close()
