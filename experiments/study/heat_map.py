"""A heat map of cores that were never trained on their targets: how much of each target's range they reach at once."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np
from matplotlib.figure import Figure

from experiments.matrix.arms import ZERO_ACTION
from experiments.report.references import best
from experiments.report.verdict import TRANSFER
from experiments.study.cells import short
from transferkit.plots import verbatim

if TYPE_CHECKING:
    from collections.abc import Iterable

    from experiments.matrix.table import Row
    from experiments.study.rooms import Study

LIGHT = 0.55
"""Share of the range from which cells are so light that their text is dark."""


def draw_heat_map(study: Study) -> Figure:
    """A line for every core, a column for every target: the mean over members, bold if it is above every control."""
    rows = study.rows
    cores, targets = sorted({row.core for row in rows if row.core}), sorted({row.target for row in rows})
    size = (3 + 0.9 * len(targets), 2 + 0.42 * len(cores))
    figure = Figure(figsize=size, layout="constrained")
    axis = figure.subplots()
    shares = np.array([[_share(rows, core, target) for target in targets] for core in cores])
    picture = axis.imshow(np.ma.masked_invalid(shares), vmin=0, vmax=1, cmap="viridis", aspect="auto")
    for (i, j), share in np.ndenumerate(shares):
        if np.isfinite(share):
            own = _mean(_of(rows, TRANSFER, cores[i], targets[j]))
            wins = own > max(_mean(_of(rows, arm, cores[i], targets[j])) for arm in _controls(rows))
            colour = "black" if share > LIGHT else "white"
            axis.text(j, i, f"{own:.0f}", ha="center", va="center", color=colour, fontweight="bold" if wins else "normal")
    axis.set_xticks(range(len(targets)), [verbatim(short(name)) for name in targets], rotation=40, ha="right")
    axis.set_yticks(range(len(cores)), [verbatim(name) for name in cores])
    bar = figure.colorbar(picture, ax=axis, shrink=0.8)
    bar.set_label("0: zero action, 1: best known", fontsize="small")
    axis.set_title("untrained; bold: above every control", fontsize="medium")
    return figure


def _share(rows: Iterable[Row], core: str, target: str) -> float:
    """How far a core is on the way from zero action to the best that is known of a target; NaN if it did not play."""
    own, zero = _mean(_of(rows, TRANSFER, core, target)), _mean(_of(rows, ZERO_ACTION, "", target))
    top, _ = best(target, max(row.eval_return_mean for row in rows if row.target == target))
    return float(np.clip((own - zero) / (top - zero), 0, 1)) if top > zero else float("nan")


def _controls(rows: Iterable[Row]) -> list[str]:
    return sorted({row.arm for row in rows} - {TRANSFER})


def _of(rows: Iterable[Row], arm: str, core: str, target: str) -> list[float]:
    """Returns of an arm; controls without a core belong to every core."""
    return [row.eval_return_mean for row in rows if (row.arm, row.target) == (arm, target) and row.core in (core, "")]


def _mean(values: list[float]) -> float:
    return float(np.mean(values)) if values else float("nan")
