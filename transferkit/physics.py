"""MuJoCo, which everything here imports from this module, so that no value of MUJOCO_GL can stop what renders nothing."""

from __future__ import annotations

import logging
import os

try:
    import mujoco
except (AttributeError, OSError, RuntimeError) as error:  # of PyOpenGL without its library, and of MuJoCo
    chosen = os.environ.get("MUJOCO_GL", "")
    os.environ["MUJOCO_GL"] = "disable"
    import mujoco

    reason = (str(error).splitlines() or [type(error).__name__])[0]
    logging.getLogger("transferkit").warning("MUJOCO_GL=%s cannot be used and is ignored: %s", chosen, reason)

__all__ = ["mujoco"]

# MuJoCo's own handler prints to stdout and leaves a MUJOCO_LOG.TXT in the working directory.
mujoco.set_mju_user_warning(logging.getLogger("mujoco").info)
