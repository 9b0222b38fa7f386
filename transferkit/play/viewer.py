"""MuJoCo's viewer, in which a play runs in real time."""

from __future__ import annotations

import time
from collections.abc import Iterator
from contextlib import ExitStack, contextmanager
from typing import TYPE_CHECKING, Any

import gymnasium

from transferkit.envs import name_of, open_simulation
from transferkit.errors import EnvironmentContractError
from transferkit.physics import mujoco, viewer_of
from transferkit.play.camera import camera_of
from transferkit.play.figures import Figures
from transferkit.renderer import load_before_drivers, no_window

if TYPE_CHECKING:
    from transferkit.envs import Simulation
    from transferkit.play.moment import Inputs, Moment, Show

VIDEO = "make a video: {out=FILE.mp4}"
"""The remedy for what the viewer cannot do."""

REDRAW, REDRAW_FIGURES = 1 / 60, 1 / 30
"""Seconds between two pictures; the figures of the inputs take longer to draw."""

LATE = 0.5
"""Seconds behind time after which the clock is set again; before that pictures are left out."""

PAUSE = 1.0
"""Seconds for which the end of an episode is seen."""


@contextmanager
def viewer(env: gymnasium.Env, inputs: Inputs | None) -> Iterator[Show]:
    """Make a function that shows a moment when it is due; it says no once the window is closed.

    Raises:
        EnvironmentContractError: the environment is not MuJoCo, or no window opens.
    """
    if reason := no_window():
        raise EnvironmentContractError(f"MuJoCo's viewer cannot open: {reason}", remedy=VIDEO)
    simulation = open_simulation(env)
    if simulation is None:
        raise EnvironmentContractError(
            f"{name_of(env)} is not a MuJoCo environment, which is what the viewer shows", remedy=VIDEO
        )
    load_before_drivers()
    window = _Window(simulation, inputs)
    try:
        yield window.show
    finally:
        window.close()


class _Window:
    """The viewer of a simulation, which is opened anew when the environment makes another model."""

    def __init__(self, simulation: Simulation, inputs: Inputs | None) -> None:
        self._simulation = simulation
        self._figures = None if inputs is None else Figures(inputs)
        self._period = REDRAW if inputs is None else REDRAW_FIGURES
        self._opened = ExitStack()
        self._viewer: Any = None
        self._model, self._data = None, None
        self._start = self._drawn = 0.0

    def show(self, moment: Moment) -> bool:
        """Show a moment at its time; if there is no time, not at all."""
        model, data = self._simulation.model, self._simulation.data
        if self._model is not model or self._data is not data:
            self._open(model, data)
        if moment.step == 0:
            self._start = time.monotonic() - data.time
        early = self._wait(data.time)
        since = time.monotonic() - self._drawn
        if moment.step == 0 or moment.last or (since >= self._period and early) or since >= LATE:
            self._draw(moment)
        if moment.last:
            time.sleep(PAUSE)
        return self._viewer.is_running()

    def close(self) -> None:
        """Close the window, if it is open."""
        self._opened.close()

    def _open(self, model: mujoco.MjModel, data: mujoco.MjData) -> None:
        self.close()
        self._viewer, self._model, self._data = self._opened.enter_context(viewer_of(model, data)), model, data
        camera = camera_of(model)
        if camera >= 0:
            with self._viewer.lock():
                self._viewer.cam.type, self._viewer.cam.fixedcamid = mujoco.mjtCamera.mjCAMERA_FIXED, camera

    def _wait(self, simulated: float) -> bool:
        """Wait until a simulated time is due; returns whether it was not yet."""
        early = self._start + simulated - time.monotonic()
        if early < -LATE:
            self._start -= early
        time.sleep(max(0.0, early))
        return early >= 0

    def _draw(self, moment: Moment) -> None:
        """Draw, with the inputs on the window's right side."""
        window = self._viewer.viewport
        if self._figures is not None and window is not None and window.height:
            self._viewer.set_figures(self._figures.of(moment, window))
        self._viewer.sync()
        self._drawn = time.monotonic()
