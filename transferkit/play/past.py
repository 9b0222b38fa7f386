"""The last seconds of a policy's inputs."""

from __future__ import annotations

from collections import deque
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from transferkit.plots import MOST_TRACES

if TYPE_CHECKING:
    from transferkit.play.moment import Inputs, Moment

WINDOW = 3.0
"""Simulated seconds that are kept."""

LEAST = 1e-9
"""What an input is scaled to that was never anything but 0."""


class Past:
    """The first inputs, as many as can be drawn, of the last moments of an episode."""

    def __init__(self, inputs: Inputs) -> None:
        self._inputs = inputs
        self.names = inputs.names[:MOST_TRACES]
        more = f", first {MOST_TRACES} of {len(inputs.names)}" if len(inputs.names) > MOST_TRACES else ""
        self.title = inputs.title + more
        self._largest = np.full(len(self.names), LEAST)
        self._rows: deque[tuple[float, NDArray[np.float32]]] = deque()

    def add(self, moment: Moment) -> None:
        """Add the inputs of a moment; a new episode has no past."""
        values = self._inputs.at(moment)[: len(self.names)]
        self._largest = np.maximum(self._largest, np.abs(values))
        if self._rows and moment.seconds <= self._rows[-1][0]:
            self._rows.clear()
        self._rows.append((moment.seconds, values))
        while self._rows[0][0] < moment.seconds - WINDOW:
            self._rows.popleft()

    @property
    def values(self) -> NDArray[np.float32]:
        """The inputs of now."""
        return self._rows[-1][1]

    def times(self) -> NDArray[np.float64]:
        """Return when the rows were, `(rows,)`, in seconds before now."""
        return np.array([at for at, _ in self._rows]) - self._rows[-1][0]

    def shares(self) -> NDArray[np.float64]:
        """Return the rows, `(rows, inputs)`, in units of the largest value so far."""
        return np.array([values for _, values in self._rows]) / self._largest
