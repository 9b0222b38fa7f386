"""A heat map of cores that were never trained on their targets: how much of each target's range they reach at once."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np
from matplotlib.figure import Figure

from experiments.report.references import best
from experiments.study.cells import short
from experiments.study.crossings import crossing
from transferkit.plots import verbatim

if TYPE_CHECKING:
    from collections.abc import Sequence

    from experiments.matrix.table import Row
    from experiments.study.rooms import Study
    from transferkit.zoo.crossings import Crossing

LIGHT = 0.55
"""Share of the range from which cells are so light that their text is dark."""


def draw_heat_map(study: Study) -> Figure:
    """A line for every core, a column for every target: the mean over members, bold if each is above every control."""
    rows = study.rows
    cores, targets = sorted({row.core for row in rows if row.core}), sorted({row.target for row in rows})
    size = (3 + 0.9 * len(targets), 2 + 0.42 * len(cores))
    figure = Figure(figsize=size, layout="constrained")
    axis = figure.subplots()
    played = {(row.core, row.target) for row in rows}
    cells = {
        (i, j): crossing(rows, core, target)
        for i, core in enumerate(cores)
        for j, target in enumerate(targets)
        if (core, target) in played
    }
    shares = np.full((len(cores), len(targets)), np.nan)
    for place, found in cells.items():
        shares[place] = _share(rows, found)
    picture = axis.imshow(np.ma.masked_invalid(shares), vmin=0, vmax=1, cmap="viridis", aspect="auto")
    for (i, j), found in cells.items():
        if np.isfinite(share := shares[i, j]):
            colour, weight = "black" if share > LIGHT else "white", "bold" if found.crosses else "normal"
            axis.text(j, i, f"{found.mean:.0f}", ha="center", va="center", color=colour, fontweight=weight)
    axis.set_xticks(
        range(len(targets)), [verbatim(short(name)).replace("&", "\n&") for name in targets], rotation=40, ha="right"
    )
    axis.set_yticks(range(len(cores)), [verbatim(name) for name in cores])
    bar = figure.colorbar(picture, ax=axis, shrink=0.8)
    bar.set_label("0: zero action, 1: best known", fontsize="small")
    axis.set_title("untrained; bold: every member above every control", fontsize="medium")
    return figure


def _share(rows: Sequence[Row], found: Crossing) -> float:
    """How far a core is on the way from zero action to the best that is known of a target; NaN if there is no way."""
    top, _ = best(found.target, max(row.eval_return_mean for row in rows if row.target == found.target))
    return float(np.clip((found.mean - found.zero) / (top - found.zero), 0, 1)) if top > found.zero else float("nan")
