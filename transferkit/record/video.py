"""Video of a replay, through MuJoCo's offscreen renderer."""

from __future__ import annotations

import os
import subprocess
import sys
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import TYPE_CHECKING, Any

import gymnasium

from transferkit.errors import RecordingError

if TYPE_CHECKING:
    from transferkit.record.replay import OnFrame

FPS = 30.0
"""The most frames a second of simulated time."""

PROBE = "import mujoco; mujoco.GLContext(64, 64).make_current()"


def choose_renderer() -> None:
    """Render without a display where there is none; has to run before mujoco is imported first."""
    if sys.platform == "linux" and "DISPLAY" not in os.environ:
        os.environ.setdefault("MUJOCO_GL", "egl")


def check_renderer() -> None:
    """Try it in a process of its own, since a broken driver may end one.

    Raises:
        RecordingError: nothing can be rendered here.
    """
    probe = subprocess.run([sys.executable, "-c", PROBE], capture_output=True, text=True, check=False)
    if probe.returncode:
        reason = (probe.stderr.strip().splitlines() or ["no reason given"])[-1]
        raise RecordingError(
            f"nothing can be rendered here ({reason}); install a GL driver (Debian: libegl1), or leave out --video"
        )


@contextmanager
def video(path: Path, time_step: float) -> Iterator[OnFrame]:
    """A function that adds a frame of an environment in render mode `rgb_array`, at most `FPS` a simulated second.

    Call `check_renderer` first.
    """
    import imageio_ffmpeg  # type: ignore[import-untyped] # noqa: PLC0415 - brings ffmpeg; only videos need it

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
