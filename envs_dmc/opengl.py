"""dm_control's OpenGL, which it opens as it is imported: kept shut until something is rendered.

A driver may bring an LLVM of its own, as Mesa's does, and a process that then imports Triton crashes.
"""

from __future__ import annotations

import importlib
import os
from collections.abc import Iterator
from contextlib import contextmanager

MUJOCO_GL = "MUJOCO_GL"


@contextmanager
def no_opengl() -> Iterator[None]:
    """Keep what is imported meanwhile from opening a renderer."""
    chosen = os.environ.get(MUJOCO_GL)
    os.environ[MUJOCO_GL] = "disable"
    try:
        yield
    finally:
        del os.environ[MUJOCO_GL]
        if chosen is not None:
            os.environ[MUJOCO_GL] = chosen


def open_renderer() -> None:
    """Let dm_control choose its renderer again, by MUJOCO_GL as it is now."""
    importlib.reload(importlib.import_module("dm_control._render"))
