"""A study's figure: evaluations during training, for the studies that keep them in `curves.csv`."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING

import numpy as np
from matplotlib.figure import Figure

from experiments.study.kinds import ARMS
from transferkit import stats
from transferkit.plots import COLOURS, verbatim

if TYPE_CHECKING:
    from matplotlib.axes import Axes

    from experiments.matrix.table import Row
    from experiments.study.rooms import Study

POINTS = 41
"""Of a line whose runs were evaluated at different steps."""

BESIDE = 4
"""Panels in a row."""

DASHES = ("-", "--", ":", "-.")
"""Line styles, each for the next five lines."""


def draw(study: Study) -> Figure:
    """A panel for every target, a line for every trainer and arm: the interquartile mean over environment steps."""
    rows = [row for row in study.rows if row.id in study.curves]
    targets = sorted({row.target for row in rows})
    trainers = sorted({row.trainer for row in rows})
    lines = [(trainer, arm) for trainer in trainers for arm in ARMS if _of(rows, trainer, arm)]
    across, down = min(BESIDE, len(targets)), -(-len(targets) // BESIDE)
    figure = Figure(figsize=(max(7, 4.5 * across), 4 * down), layout="constrained")
    axes = figure.subplots(down, across, squeeze=False)
    for axis in axes.flat[len(targets) :]:
        axis.remove()
    for axis, target in zip(axes.flat, targets, strict=False):
        axis.set(title=verbatim(target).replace("&", "\n&"), xlabel="environment steps")
        axis.locator_params(axis="x", nbins=5)
        for k, (trainer, arm) in enumerate(lines):
            label = verbatim(", ".join([ARMS[arm], *([trainer] if len(trainers) > 1 else [])]))
            _line(axis, study, _of(rows, trainer, arm, target), label, (COLOURS[k % 5], DASHES[k // 5 % len(DASHES)]))
    for axis in axes[:, 0]:
        axis.set_ylabel("evaluation, IQM with 95 % interval")
    named = {label: line for axis in figure.axes for line, label in zip(*axis.get_legend_handles_labels(), strict=True)}
    figure.legend(named.values(), named, loc="outside lower center", ncols=2, fontsize="small", frameon=False)
    return figure


def _of(rows: Sequence[Row], trainer: str, arm: str, target: str | None = None) -> list[Row]:
    return [row for row in rows if (row.trainer, row.arm) == (trainer, arm) and target in (None, row.target)]


def _line(axis: Axes, study: Study, rows: Sequence[Row], label: str, style: tuple[str, str]) -> None:
    """One line, over the steps that every run has."""
    if not rows:
        return
    runs = [np.transpose([(point["steps"], point["return_mean"]) for point in study.curves[row.id]]) for row in rows]
    alike = all(np.array_equal(run[0], runs[0][0]) for run in runs)
    steps = runs[0][0] if alike else np.linspace(max(run[0, 0] for run in runs), min(run[0, -1] for run in runs), POINTS)
    values = np.array([np.interp(steps, *run) for run in runs])
    low, high = np.transpose([stats.iqm_interval(column) for column in values.T])
    colour, dashes = style
    axis.plot(steps, stats.iqm(values, axis=0), dashes, color=colour, label=label)
    axis.fill_between(steps, low, high, color=colour, alpha=0.15, linewidth=0)
