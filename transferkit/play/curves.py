"""The last seconds of a policy's inputs as a picture, quickly enough for every frame of a video."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.figure import Figure
from numpy.typing import NDArray

from transferkit.play.past import WINDOW, Past
from transferkit.plots import COLOURS, verbatim

if TYPE_CHECKING:
    from transferkit.play.moment import Inputs, Moment

WIDTH, DPI = 320, 100
"""Of the picture: pixels, and pixels of an inch."""

HALF = 0.3
"""How high a curve may rise, in rows."""


class Curves:
    """One row an input, from the past on the left to now on the right."""

    def __init__(self, inputs: Inputs, height: int) -> None:
        self._past = Past(inputs)
        self._figure = Figure(figsize=(WIDTH / DPI, height / DPI), dpi=DPI)
        self._canvas = FigureCanvasAgg(self._figure)
        self._draw_page()
        self._canvas.draw()
        self._page = self._canvas.copy_from_bbox(self._figure.bbox)

    def picture(self, moment: Moment) -> NDArray[np.uint8]:
        """Add the inputs of a moment, and draw, `(height, width, 3)`."""
        self._past.add(moment)
        times, shares = self._past.times(), self._past.shares()
        self._canvas.restore_region(self._page)
        for row, (line, text) in enumerate(zip(self._lines, self._texts, strict=True)):
            line.set_data(times, shares[:, row] * HALF - row)
            text.set_text(f"{self._past.values[row]:+.3g}")
            self._axes.draw_artist(line)
            self._axes.draw_artist(text)
        return np.asarray(self._canvas.buffer_rgba())[..., :3].copy()

    def _draw_page(self) -> None:
        """Draw what stays."""
        names, count = self._past.names, len(self._past.names)
        self._axes = axes = self._figure.add_axes((0.04, 0.07, 0.92, 0.87))
        axes.set(xlim=(-WINDOW, 0), ylim=(0.4 - count, 0.7), yticks=(), xticks=())
        axes.set_xlabel(f"last {WINDOW:g} s; each row is scaled to its largest value so far", fontsize=7)
        axes.spines[:].set_visible(False)
        axes.set_title(self._past.title, fontsize=9)
        for row, name in enumerate(names):
            axes.axhspan(-0.34 - row, 0.62 - row, color="0.95", linewidth=0)
            axes.axhline(-row, color="0.8", linewidth=0.8)
            axes.text(-WINDOW, HALF - row, verbatim(name), fontsize=7, va="bottom")
        self._lines = [axes.plot([], [], color=COLOURS[0], linewidth=1.2, animated=True)[0] for _ in names]
        right = {"fontsize": 7, "va": "bottom", "ha": "right", "animated": True}
        self._texts = [axes.text(0, HALF - row, "", **right) for row in range(count)]
