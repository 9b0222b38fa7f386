"""An episode as a strip of pictures."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from contextlib import closing, contextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING

import gymnasium
import numpy as np
from matplotlib import pyplot as plt
from matplotlib.axes import Axes
from numpy.typing import NDArray

from transferkit.play.camera import Camera
from transferkit.plots import COLOURS, MOST_TRACES, save_figure, verbatim

if TYPE_CHECKING:
    from transferkit.play.moment import Inputs, Moment, Show

PICTURES = 8
KEPT = 32
"""Shots of an episode, from which the pictures are chosen when its length is known."""

INCH, ROW = 1.6, 0.22
"""Inches of a picture's side, and of an input."""


@dataclass(frozen=True)
class Shot:
    """A picture, and the inputs at that moment."""

    seconds: float
    picture: NDArray[np.uint8]
    inputs: NDArray[np.float32] | None


@contextmanager
def strip(path: Path, env: gymnasium.Env, inputs: Inputs | None) -> Iterator[Show]:
    """Make a function that looks at a moment of an episode, and draw pictures of some, evenly spaced, when all is done.

    Raises:
        ConfigError: the file cannot be written.
    """
    with closing(Camera(env)) as camera:
        roll = _Roll(camera, inputs)
        yield roll.show
    draw_strip(evenly_spaced(roll.shots), path, inputs)


class _Roll:
    """Shots of an episode of any length, at most twice `KEPT`."""

    def __init__(self, camera: Camera, inputs: Inputs | None) -> None:
        self._camera, self._inputs = camera, inputs
        self._every = 1
        self.shots: list[Shot] = []

    def show(self, moment: Moment) -> bool:
        if len(self.shots) == 2 * KEPT:
            self.shots, self._every = self.shots[::2], 2 * self._every
        if moment.step % self._every == 0 or moment.last:
            inputs = None if self._inputs is None else self._inputs.at(moment)
            self.shots.append(Shot(moment.seconds, self._camera.picture(), inputs))
        return True


def evenly_spaced(shots: Sequence[Shot]) -> list[Shot]:
    """Choose the shots that are nearest to evenly spaced times, each once."""
    times = np.array([shot.seconds for shot in shots])
    wanted = np.linspace(0, times[-1], min(PICTURES, len(shots)))
    return [shots[k] for k in sorted({int(np.abs(times - at).argmin()) for at in wanted})]


def draw_strip(shots: Sequence[Shot], path: Path, inputs: Inputs | None) -> None:
    """Draw shots in a row with their times beneath, and with bars of the inputs below.

    Raises:
        ConfigError: the file cannot be written.
    """
    count = 0 if inputs is None else min(len(inputs.names), MOST_TRACES)
    rows = [INCH] if inputs is None else [INCH, max(4, count) * ROW]
    side = 0 if inputs is None else 2.0
    figure, axes = plt.subplots(
        len(rows),
        len(shots),
        figsize=(INCH * len(shots) + side, sum(rows) + 0.5),
        height_ratios=rows,
        squeeze=False,
        layout="constrained",
    )
    for axis, shot in zip(axes[0], shots, strict=True):
        axis.imshow(shot.picture)
        axis.set(xticks=(), yticks=(), xlabel=f"{shot.seconds:.2f} s")
        axis.spines[:].set_visible(False)
    if inputs is not None:
        _draw_bars(axes[1], shots, inputs, count)
    save_figure(figure, path)


def _draw_bars(axes: Sequence[Axes], shots: Sequence[Shot], inputs: Inputs, count: int) -> None:
    values = np.array([shot.inputs for shot in shots])[:, :count]
    largest = np.maximum(np.abs(values).max(axis=0), 1e-9)
    for axis, row in zip(axes, values, strict=True):
        axis.barh(range(count), row / largest, color=[COLOURS[0] if value >= 0 else COLOURS[1] for value in row])
        axis.axvline(0, color="0.5", linewidth=0.8)
        axis.set(xlim=(-1.05, 1.05), ylim=(count - 0.5, -0.5), xticks=(), yticks=())
    names = [f"{verbatim(name)}  ±{most:.2g}" for name, most in zip(inputs.names, largest, strict=False)]
    axes[0].set_yticks(range(count), names, fontsize="x-small")
    more = f",\nfirst {count} of {len(inputs.names)}" if count < len(inputs.names) else ""
    axes[0].set_ylabel(inputs.title + more, fontsize="small")
