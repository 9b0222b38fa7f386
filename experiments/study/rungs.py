"""A line for every rung of the ladder: what a core saved, whether it cost anything, and the verdict."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING

import numpy as np

from experiments.matrix.arms import ZERO_ACTION
from experiments.report.ladder import ORDER
from experiments.report.tables import core_share, source_steps
from experiments.report.verdict import NONE, REFUSED, SCRATCH, TRANSFER
from experiments.study.cells import difference, short, verdict, whole
from experiments.study.rooms import StudyError
from transferkit import stats

if TYPE_CHECKING:
    from collections.abc import Mapping, Sequence

    from experiments.matrix.table import Row
    from experiments.report.comparisons import Group
    from experiments.report.curves import Array
    from experiments.study.rooms import Study

HEADER = (
    *("rung", "core on target", "trainer", "source steps", "doing nothing", "area: core, scratch", "difference, as judged"),
    *("first: core, scratch", "end: core, scratch", "difference", "stood in", "learner around the core"),
    *("below scratch's lower quartile", "below the untrained core", "steps saved"),
)


def rungs(study: Study, thresholds: Mapping[str, float] | None = None) -> list[list[str]]:
    """Every comparison with a core, rung by rung.

    Differences are core minus scratch; that of areas has the interval that decides, for four comparisons. The *learner* is
    the mean return of the last 50 training episodes, with noise, also of runs for which the untrained core stands in:
    *stood in* is the share of evaluations that it played, from the first on in runs of a trusted core. *Steps saved* is how
    many times as many steps scratch needs to a threshold, by medians, with the bootstrap's interval over seeds.
    `thresholds` has those that were stated for targets before the runs. Another target's is halfway from scratch, its mean
    start or end, whichever is higher, to the core's mean end above it.
    """
    groups = [group for group in study.groups if group.core]
    groups.sort(key=lambda group: (ORDER.index(group.rung), group.target, group.trainer))
    stated = thresholds or {}
    grid = (study.folder / "grid.toml").read_text() if stated else ""
    for target in stated:
        if f'"{target}"' not in grid:
            raise StudyError(f"thresholds: {target} is no target of the grid")
    return [[*HEADER, "verdict"], *([*_cells(study, group, stated.get(group.target)), _verdict(group)] for group in groups)]


def _cells(study: Study, group: Group, threshold: float | None) -> list[str]:
    area, first, end = (_pair(group.measured(name)) for name in ("area", "first_return_mean", "eval_return_mean"))
    nothing = [row.eval_return_mean for row in study.rows if (row.target, row.arm) == (group.target, ZERO_ACTION)]
    learner = [row.last_50_mean for row in group.arms[TRANSFER].rows if math.isfinite(row.last_50_mean)]
    name = f"`{group.core}` on {short(group.target)}"
    spent = source_steps(group.core)
    known = ["-" if spent is None else f"{spent:,.0f}", _mean(nothing)]
    differences = difference(group.verdict.primary.get(SCRATCH)), difference(group.verdict.scratch)
    start = [group.rung, name, group.trainer, *known, area, differences[0], first, end, differences[1]]
    saved = "-" if group.verdict.kind == REFUSED else _saved(study, group, threshold)
    stood_in = core_share(group)
    return [
        *start,
        "-" if stood_in is None else f"{stood_in:.0%}",
        _mean(learner),
        _worse(group),
        _forgotten(study, group),
        saved,
    ]


def _mean(values: Sequence[float]) -> str:
    return whole(float(np.mean(values))) if values else "-"


def _pair(scores: dict[str, Array]) -> str:
    return ", ".join(whole(float(np.nanmean(scores[name]))) for name in (TRANSFER, SCRATCH))


def _worse(group: Group) -> str:
    """Share of the core's runs that end below the lower quartile of scratch's."""
    ends = group.scores
    core = ends[TRANSFER][~np.isnan(ends[TRANSFER])]
    return f"{np.mean(core < np.nanquantile(ends[SCRATCH], 0.25)):.0%}"


def _forgotten(study: Study, group: Group) -> str:
    """Share of the runs around a trusted core that end below what it had untrained, by more than both evaluations' noise.

    That is two standard errors of the difference, by the last evaluation's deviation. A diverged run counts as below.
    """
    begun = [row for row in group.arms[TRANSFER].rows if row.id in study.curves and study.curves[row.id][0].get("core")]
    noise = [2 * row.eval_return_std * math.sqrt(2 / row.eval_episodes) for row in begun]
    below = [row.eval_return_mean < row.first_return_mean - one for row, one in zip(begun, noise, strict=True)]
    below += [True] * len(group.arms[TRANSFER].diverged)
    return f"{np.mean(below):.0%}" if below else "-"


def _saved(study: Study, group: Group, threshold: float | None) -> str:
    """The data-efficiency multiplier; scratch's runs that never get there count with all of their steps, so it is more."""
    if threshold is None:
        alone = max(float(np.nanmean(group.measured(name)[SCRATCH])) for name in ("first_return_mean", "eval_return_mean"))
        threshold = (alone + float(np.nanmean(group.scores[TRANSFER]))) / 2
        if threshold <= alone:
            return "-"
    core, needed = (_needed(study, group, name, threshold) for name in (TRANSFER, SCRATCH))
    paired = ~(np.isnan(core).any(axis=0) | np.isnan(needed).any(axis=0))
    core, needed = core[:, paired], needed[0, paired]
    if not needed.size or np.isinf(np.median(core)):
        return "-"
    least = np.fmin(needed, group.each(SCRATCH, lambda row: study.curves[row.id][-1]["steps"])[0, paired])
    times = stats.data_efficiency(least, core)
    low, high = stats.data_efficiency_interval(least, core)
    sign = "> " if np.isinf(np.median(needed)) else ""
    return f"{sign}{times:.2g} ({low:.2g} to {high:.2g}) to {whole(threshold)}"


def _needed(study: Study, group: Group, arm: str, threshold: float) -> Array:
    """Steps to the threshold, `(members, seeds)`; infinite if a run never gets there, NaN if it is missing."""

    def steps(row: Row) -> float:
        curve = study.curves[row.id]
        taken, returns = ([point[key] for point in curve] for key in ("steps", "return_mean"))
        return stats.steps_to_threshold(taken, returns, threshold)

    return group.each(arm, steps, diverged=math.inf)


def _verdict(group: Group) -> str:
    refused = f"refused in {group.refused:.0%}"
    if group.verdict.kind == REFUSED:
        return refused
    kind, both = group.verdict.kind, verdict(group)
    if kind != NONE and len({row.member for row in group.arms[TRANSFER].rows}) == 1:
        both = f"{kind}, of one member"
    return f"{both}, {refused}" if group.refused else both
