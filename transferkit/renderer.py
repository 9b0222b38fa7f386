"""The choice of what renders: a value of MUJOCO_GL that works here, whatever the user's is."""

from __future__ import annotations

import functools
import importlib
import os
import sys
from contextlib import suppress

from transferkit.attempt import attempt
from transferkit.errors import EnvironmentContractError

RENDERERS = ("glfw", "egl", "osmesa")
"""Values of MUJOCO_GL that MuJoCo, Gymnasium and dm_control all know, in the order in which they try them."""

DISPLAYS = ("DISPLAY", "WAYLAND_DISPLAY")
"""Variables that name a display on Linux."""

RENDER = """
import mujoco
model = mujoco.MjModel.from_xml_string('<mujoco><worldbody><geom size=".1"/></worldbody></mujoco>')
data = mujoco.MjData(model)
mujoco.mj_forward(model, data)
with mujoco.Renderer(model, 16, 16) as renderer:
    renderer.update_scene(data)
    renderer.render()
"""


def find_renderer() -> str | None:
    """Find a value of MUJOCO_GL that renders here, the user's if it does; None if nothing renders."""
    chosen = os.environ.get("MUJOCO_GL", "").lower().strip()
    candidates = sorted(RENDERERS, key=lambda renderer: renderer != chosen)
    return next(filter(_renders, candidates), None)


def choose_renderer() -> None:
    """Set MUJOCO_GL to a value that renders here.

    Raises:
        EnvironmentContractError: nothing can be rendered here.
    """
    renderer = find_renderer()
    if renderer is None:
        remedy = "install a GL driver (Debian: libegl1)"
        raise EnvironmentContractError("nothing can be rendered here", remedy=remedy, topic="installation")
    os.environ["MUJOCO_GL"] = renderer
    load_before_drivers()


def load_before_drivers() -> None:
    """Import what crashes if a driver that brings its own LLVM, as Mesa's does, is there first."""
    with suppress(ImportError):
        importlib.import_module("triton")


def no_window() -> str:
    """Say why no window can be opened here; empty if one can."""
    if sys.platform == "linux" and not any(os.environ.get(name) for name in DISPLAYS):
        return "no display"
    return "" if _renders("glfw") else "no window opens on this display"


@functools.cache
def _renders(renderer: str) -> bool:
    return not attempt(RENDER, renderer=renderer).failure
