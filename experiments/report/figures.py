"""Figures of a report for papers: PNG and SVG by matplotlib."""

from __future__ import annotations

import math
from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from experiments.matrix.arms import UNTRAINED, WITHOUT_CORE, ZERO_ACTION
from experiments.report.verdict import TRANSFER
from transferkit import stats
from transferkit.plots import COLOURS, save_figure, verbatim

if TYPE_CHECKING:
    from experiments.report.comparisons import Group
    from experiments.report.curves import Arm, Array, Curve
    from experiments.report.matrix import Matrix

DASHES = ("-", "--", ":")
"""With the colours, enough styles for fifteen lines; dashes also tell lines apart in grey."""

LEGEND_COLUMN, LEGEND_ROW = 3.6, 0.18
"""Inches."""

PANELS = (("50-episode mean", "episodes"), ("each episode", "episodes"), ("50-episode mean", "steps"))
"""Window and axis of the learning curves."""

PROFILE_POINTS = np.linspace(0.0, 1.0, 101)


def draw_all(matrix: Matrix, folder: Path) -> list[Path]:
    """Every figure as PNG and SVG; returns the PNGs."""
    folder.mkdir(parents=True, exist_ok=True)
    drawn = []
    for target in dict.fromkeys(group.target for group in matrix.groups):
        groups = [group for group in matrix.groups if group.target == target]
        if not any(arm.curve(*panel) for arm in lines_of(groups).values() for panel in PANELS):
            continue  # only rows are known, or less than two episodes
        drawn.append(_save(_learning_curves(target, groups), folder / f"curves_{_slug(target)}"))
        model_free = [group for group in groups if group.algo == "ppo"]
        if model_free and len(model_free) < len(groups):
            drawn.append(_save(_learning_curves(target, model_free), folder / f"curves_{_slug(target)}_without_dyna"))
    scaled = [group for group in matrix.groups if group.scaled]
    if scaled:
        drawn.append(_save(_profiles(scaled), folder / "profiles"))
    return drawn


def lines_of(groups: Sequence[Group]) -> dict[str, Arm]:
    """Every trained arm of the groups of one target under a label of its own."""
    found = {}
    for group in groups:
        for name, arm in group.arms.items():
            if name in UNTRAINED:
                continue
            names = group.trainer, "" if name in WITHOUT_CORE else group.core, "" if name == TRANSFER else name
            found[", ".join(filter(None, names))] = arm
    return found


def _learning_curves(target: str, groups: Sequence[Group]) -> Figure:
    """The paper's figure: training returns over episodes, smoothed as there and not, and over environment steps."""
    figure = Figure(figsize=(15, 4.5))
    axes = figure.subplots(1, 3)
    lines = lines_of(groups)
    for axis, (window, unit) in zip(axes, PANELS, strict=True):
        curves = {label: curve for label, arm in lines.items() if (curve := arm.curve(window, unit))}
        for k, label in enumerate(lines):
            if not (curve := curves.get(label)):
                continue
            colour = COLOURS[k % len(COLOURS)]
            style = DASHES[k // len(COLOURS) % len(DASHES)]
            axis.plot(curve.x, curve.middle, style, color=colour, label=verbatim(f"{label} (n {curve.n})"))
            axis.fill_between(curve.x, curve.low, curve.high, color=colour, alpha=0.15, linewidth=0)
        _limit(axis, list(curves.values()))
        if ZERO_ACTION in groups[0].arms:
            axis.axhline(groups[0].low, color="grey", linestyle="-.", linewidth=1, label="zero action")
        axis.set_xlabel("training episodes" if unit == "episodes" else "environment steps")
        axis.set_title(f"{window}, over {unit}")
        axis.locator_params(axis="x", nbins=6)
    axes[0].set_ylabel("training return, IQM over runs with 95 % interval")
    _legend_below(figure, axes[0])
    figure.suptitle(verbatim(target))
    return figure


def _limit(axis: Axes, curves: Sequence[Curve]) -> None:
    """Cut bands if they go further from the lines than these do from each other: one diverged run would hide all others."""
    if curves:
        lowest, highest = min(curve.middle.min() for curve in curves), max(curve.middle.max() for curve in curves)
        reach = highest - lowest or 1.0
        low, high = min(curve.low.min() for curve in curves), max(curve.high.max() for curve in curves)
        axis.set_ylim(max(low, lowest - reach) - 0.05 * reach, min(high, highest + reach) + 0.05 * reach)


def _profiles(groups: Sequence[Group]) -> Figure:
    """Share of runs above every normalised score, for each trainer and arm over all its targets and cores."""
    figure = Figure(figsize=(8, 4.5))
    axis = figure.subplots()
    scores: dict[tuple[str, str], dict[tuple[str, str], Array]] = {}
    for group in groups:
        for name, values in group.scores.items():
            task = group.target, "" if name in WITHOUT_CORE else group.core
            scores.setdefault((group.trainer, name), {})[task] = group.normalized(values[np.isfinite(values)])
    for k, ((trainer, name), found) in enumerate(scores.items()):
        runs = np.concatenate(list(found.values()))
        profile = stats.performance_profile(runs, PROFILE_POINTS)
        style, label = DASHES[k // len(COLOURS) % len(DASHES)], verbatim(f"{trainer}, {name} (n {len(runs)})")
        axis.plot(PROFILE_POINTS, profile, style, color=COLOURS[k % len(COLOURS)], label=label)
    axis.set_xlabel("normalised score: 0 zero action, 1 the target's upper reference")
    axis.set_ylabel("share of runs above it")
    _legend_below(figure, axis)
    return figure


def _legend_below(figure: Figure, axis: Axes) -> None:
    """A legend under the axes, and margins in inches: a layout engine would take a third of the whole report's time."""
    lines, labels = axis.get_legend_handles_labels()
    width, height = figure.get_size_inches()
    columns = int(width // LEGEND_COLUMN)
    below = 0.65 + LEGEND_ROW * math.ceil(len(labels) / columns)
    figure.set_size_inches(width, height := height + below)
    figure.subplots_adjust(left=0.8 / width, right=1 - 0.25 / width, bottom=below / height, top=1 - 0.6 / height)
    figure.legend(lines, labels, fontsize="x-small", loc="lower center", ncols=columns, frameon=False)


def _save(figure: Figure, stem: Path) -> Path:
    for suffix in (".png", ".svg"):
        save_figure(figure, stem.with_name(stem.name + suffix))
    return stem.with_name(stem.name + ".png")


def _slug(target: str) -> str:
    return target.replace("/", "-")
