"""The last seconds of a policy's inputs as figures in MuJoCo's viewer, which draws no picture in front of a scene."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from transferkit.errors import printable
from transferkit.physics import mujoco
from transferkit.play.past import WINDOW, Past

if TYPE_CHECKING:
    from transferkit.play.moment import Inputs, Moment

WIDTH, HEIGHT = 280, 110
"""Pixels of a figure, if there is room."""

LONGEST = 60
"""Characters of a title; MuJoCo holds 1,000."""


class Figures:
    """One figure an input, from the top of the window's right side downwards."""

    def __init__(self, inputs: Inputs) -> None:
        self._past = Past(inputs)
        self._figures = [_empty() for _ in self._past.names]

    def of(self, moment: Moment, window: mujoco.MjrRect) -> list[tuple[mujoco.MjrRect, mujoco.MjvFigure]]:
        """Add the inputs of a moment, and return the figures with their places."""
        self._past.add(moment)
        times, shares = self._past.times(), self._past.shares()
        for k, figure in enumerate(self._figures):
            points = np.column_stack((times, shares[:, k])).ravel()
            figure.linepnt[0] = len(times)
            figure.linedata[0][: len(points)] = points
            figure.title = f"{printable(self._past.names[k], LONGEST)}  {self._past.values[k]:+.3g}"
        return list(zip(self._places(window), self._figures, strict=True))

    def _places(self, window: mujoco.MjrRect) -> list[mujoco.MjrRect]:
        width, height = min(WIDTH, window.width), min(HEIGHT, window.height // len(self._figures))
        left, top = window.left + window.width - width, window.bottom + window.height
        return [mujoco.MjrRect(left, top - (k + 1) * height, width, height) for k in range(len(self._figures))]


def _empty() -> mujoco.MjvFigure:
    figure = mujoco.MjvFigure()
    mujoco.mjv_defaultFigure(figure)
    figure.flg_legend, figure.flg_ticklabel[:], figure.gridsize[:] = 0, 0, (2, 3)
    figure.range[:] = (-WINDOW, 0), (-1.05, 1.05)
    return figure
