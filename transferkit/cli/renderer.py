"""The choice of MuJoCo's renderer, which has to be made before mujoco is imported."""

from __future__ import annotations

import os
import subprocess
import sys

from transferkit.errors import RecordingError

PROBE = "import mujoco; mujoco.GLContext(64, 64).make_current()"


def choose_renderer() -> None:
    """Choose to render without a display if there is none."""
    if sys.platform == "linux" and "DISPLAY" not in os.environ:
        os.environ.setdefault("MUJOCO_GL", "egl")


def check_renderer() -> None:
    """Try to render in a process of its own, which a broken driver may end.

    Raises:
        RecordingError: nothing can be rendered here.
    """
    probe = subprocess.run([sys.executable, "-c", PROBE], capture_output=True, text=True, check=False)
    if probe.returncode:
        reason = (probe.stderr.strip().splitlines() or ["no reason given"])[-1]
        raise RecordingError(
            f"nothing can be rendered here ({reason})", remedy="install a GL driver (Debian: libegl1), or leave out {video}"
        )
