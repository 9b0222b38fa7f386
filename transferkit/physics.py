"""MuJoCo, which everything here imports from this module, so that no value of MUJOCO_GL can stop what renders nothing."""

from __future__ import annotations

import logging
import os
import threading
from collections.abc import Iterator
from contextlib import contextmanager
from typing import Any

from transferkit.errors import EnvironmentContractError, reason_of

try:
    import mujoco
except (AttributeError, OSError, RuntimeError) as error:  # of PyOpenGL without its library, and of MuJoCo
    chosen = os.environ.get("MUJOCO_GL", "")
    os.environ["MUJOCO_GL"] = "disable"
    import mujoco

    logging.getLogger("transferkit").warning("MUJOCO_GL=%s cannot be used and is ignored: %s", chosen, reason_of(error))

__all__ = ["mujoco", "viewer_of"]

CLOSING = 10.0
"""Seconds that a viewer may take to close its window."""

# MuJoCo's own handler prints to stdout and leaves a MUJOCO_LOG.TXT in the working directory.
mujoco.set_mju_user_warning(logging.getLogger("mujoco").info)


@contextmanager
def viewer_of(model: mujoco.MjModel, data: mujoco.MjData) -> Iterator[Any]:
    """Open MuJoCo's viewer, without its panels, on a simulation that somebody else steps; it needs a machine with a display.

    In the end its window is gone: a process that ends earlier crashes.

    Raises:
        EnvironmentContractError: there is no library for it, or it needs a Python of its own, as on macOS.
    """
    before = set(threading.enumerate())
    try:
        from mujoco import viewer  # noqa: PLC0415 - it loads GLFW

        handle = viewer.launch_passive(model, data, show_left_ui=False, show_right_ui=False)
    except (ImportError, OSError, RuntimeError) as error:
        reason = " ".join(str(error).replace("`", "").split())
        raise EnvironmentContractError(
            f"MuJoCo's viewer does not open: {reason}", remedy="make a video: {out=FILE.mp4}", topic="installation"
        ) from None
    its_threads = set(threading.enumerate()) - before
    try:
        yield handle
    finally:
        handle.close()
        for thread in its_threads:
            thread.join(CLOSING)
