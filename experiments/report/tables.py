"""Numbers of a report as rows, for the page and for CSV files."""

from __future__ import annotations

import functools
import math
from collections.abc import Mapping, Sequence
from typing import TYPE_CHECKING

import numpy as np

from experiments.matrix.arms import UNTRAINED, WITHOUT_CORE
from experiments.report.comparisons import card_of
from experiments.report.verdict import SCRATCH, TRANSFER, paired
from transferkit import stats

if TYPE_CHECKING:
    from experiments.report.comparisons import Group
    from experiments.report.curves import Arm, Array, Key

TableRow = Mapping[str, object]
"""A line of a table by column."""

HALFWAY = 0.5
"""The threshold of time to threshold, on the scale from zero action (0) to the upper reference (1)."""

ENDS = ("mean", "low", "high")
"""A difference and its interval."""

MEANS = {"all": "all_mean", "seconds": "seconds", "steps": "steps"}
"""Columns of the paper's measures that are plain means."""


@functools.cache
def arm_rows(group: Group) -> list[TableRow]:
    """One row for every arm of a comparison."""
    return [_arm_row(group, arm) for arm in group.arms.values()]


def _arm_row(group: Group, arm: Arm) -> TableRow:
    values = arm.returns[None] if arm.name in UNTRAINED else complete(group.scores[arm.name])
    low, high = mean_interval(values) if arm.rows else (None, None)  # of copies of another arm's run
    row = {
        "target": group.target,
        "trainer": group.trainer,
        "core": group.core,
        "arm": arm.name,
        "n": values.size,
        "failed": len(arm.failed),
        "iqm": stats.iqm(values) if values.size else None,
        "mean": float(values.mean()) if values.size else None,
        "mean_low": low,
        "mean_high": high,
        "normalized": float(group.normalized(values).mean()) if group.scaled and values.size else None,
        "difference": None,
        "difference_low": None,
        "difference_high": None,
        "corrected": None,
        "p_better": None,
    }
    return row | (_against(group, arm.name) if arm.name not in (TRANSFER, *UNTRAINED) and TRANSFER in group.scores else {})


def complete(values: Array) -> Array:
    """The seeds that every member has, of values `(members, seeds)`."""
    return values[:, np.isfinite(values).all(axis=0)]


def mean_interval(values: Array) -> tuple[float | None, float | None]:
    """Interval of the mean over members and seeds, both a sample; one run has none."""
    return stats.crossed_interval(values) if values.size > 1 else (None, None)


def _against(group: Group, arm: str) -> dict[str, float]:
    """Transfer minus this arm in pairs, and the probability that a run of the transfer beats one of it."""
    usable = paired(group.scores, (TRANSFER, arm))
    if usable[arm].shape[1] < 2:
        return {}
    found = group.verdict.controls.get(arm) or stats.paired_difference(usable[TRANSFER], usable[arm])
    better = stats.probability_of_improvement(usable[TRANSFER], usable[arm])
    return {
        "difference": found.mean,
        "difference_low": found.low,
        "difference_high": found.high,
        "corrected": arm in group.verdict.controls,
        "p_better": better,
    }


@functools.cache
def curve_rows(group: Group) -> list[TableRow]:
    """Taylor and Stone's measures of transfer and scratch; empty without evaluations during training, or without references."""
    arms = {name: group.arms[name].evaluations for name in (TRANSFER, SCRATCH) if name in group.arms}
    if len(arms) < 2 or not all(arms.values()) or group.low is None or group.high is None:
        return []
    threshold = group.low + HALFWAY * (group.high - group.low)
    reached = {
        name: [stats.steps_to_threshold(run["steps"], run["returns"], threshold) for run in runs.values()]
        + [math.inf] * len(group.arms[name].diverged)
        for name, runs in arms.items()
    }
    horizon = min(run["steps"][-1] for runs in arms.values() for run in runs.values())
    starts = {name: float(np.mean([run["returns"][0] for run in runs.values()])) for name, runs in arms.items()}
    source = source_steps(group.core)
    compared = {
        "jumpstart": stats.jumpstart([starts[TRANSFER]], [starts[SCRATCH]]),
        "data_efficiency": stats.data_efficiency(reached[SCRATCH], reached[TRANSFER]),
        "data_efficiency_total": source and stats.data_efficiency(reached[SCRATCH], reached[TRANSFER], source=source),
    }
    return [
        {"target": group.target, "trainer": group.trainer, "core": group.core, "arm": name, "threshold": threshold}
        | {"before_training": starts[name]}
        | _measures(runs, horizon)
        | {"steps_to_threshold": float(np.median(reached[name])), "never_reached": int(np.isinf(reached[name]).sum())}
        | (compared if name == TRANSFER else dict.fromkeys(compared))
        for name, runs in arms.items()
    ]


def _measures(runs: Mapping[Key, Mapping[str, Array]], horizon: float) -> dict[str, float]:
    """Over the steps that every run has."""
    shared = [{name: values[run["steps"] <= horizon] for name, values in run.items()} for run in runs.values()]
    return {
        "area": float(np.mean([stats.area(run["steps"], run["returns"]) for run in shared])),
        "asymptote": float(np.mean([stats.asymptote(run["steps"], run["returns"]) for run in shared])),
    }


def source_steps(core: str) -> float | None:
    """Environment steps that a member of the core cost, on average; None if the core is not here."""
    card = card_of(core)
    return card and float(np.mean([spent["steps"] for spent in card.spent]))


def core_share(group: Group) -> float | None:
    """Share of the transfer's evaluations that the untrained core played; None if runs were evaluated at their end only."""
    shares = group.grid(TRANSFER, "core_share") if TRANSFER in group.arms else np.array([])
    return float(np.nanmean(shares)) if np.isfinite(shares).any() else None


def verdict_rows(groups: Sequence[Group]) -> list[TableRow]:
    """One row for every core, target and trainer with a core."""
    return [
        {
            "target": group.target,
            "trainer": group.trainer,
            "core": group.core,
            "verdict": group.verdict.kind,
            "verdict_of_members": group.verdict_of_members,
            "own_task": group.own_task,
            "reason": group.verdict.reason,
            "rung": group.rung,
            "measure": group.verdict.measure,
            "transfer_minus_scratch": group.verdict.scratch and group.verdict.scratch.mean,
            "normalized": group.share("end"),
            **{f"{name}_{end}": found and getattr(found, end) for name, found in group.gains.items() for end in ENDS},
            "core_share": core_share(group),
            "n": group.scores[TRANSFER].size if TRANSFER in group.scores else 0,
        }
        for group in groups
        if group.core
    ]


def paper_rows(groups: Sequence[Group]) -> list[TableRow]:
    """The paper's own measures for every arm: mean training return of the last 50 episodes, and of all, over runs."""
    rows = [_paper_row(group, name) for group in groups for name in group.arms if name not in UNTRAINED]
    return list({tuple(row[key] for key in ("target", "trainer", "arm", "core")): row for row in rows if row["n"]}.values())


def _paper_row(group: Group, name: str) -> TableRow:
    last = complete(group.grid(name, "last_50_mean"))
    row = {"target": group.target, "trainer": group.trainer, "arm": name, "core": "" if name in WITHOUT_CORE else group.core}
    row |= {"n": last.size, "failed": len(group.arms[name].failed)}
    if not last.size:
        return row
    low, high = mean_interval(last)
    return row | {
        "last_50": float(last.mean()),
        "last_50_low": low,
        "last_50_high": high,
        "last_50_std": float(last.std(ddof=1)) if last.size > 1 else None,
        "last_50_median": float(np.median(last)),
        **{key: float(np.mean(complete(group.grid(name, measure)))) for key, measure in MEANS.items()},
    }


def aggregate_rows(groups: Sequence[Group]) -> list[TableRow]:
    """The interquartile mean of every arm over all targets, normalised, with the runs of each target resampled.

    Of several members it takes the mean: the interval is over seeds, for these members. Only targets that have two references
    count, and only cores whose every arm has the same number of seeds on all of them.
    """
    rows: list[TableRow] = []
    for trainer, core in dict.fromkeys((group.trainer, group.core) for group in groups if group.core):
        own = [group for group in groups if (group.trainer, group.core) == (trainer, core) and group.scaled]
        names = [name for name in (own[0].scores if own else ()) if all(name in group.scores for group in own)]
        means = {name: [group.normalized(complete(group.scores[name])).mean(axis=0) for group in own] for name in names}
        sizes = {len(values) for found in means.values() for values in found}
        if len(own) < 2 or len(sizes) > 1 or 0 in sizes:
            continue
        for name, found in means.items():
            scores = np.stack(found, axis=1)
            low, high = stats.stratified_interval(scores, stats.iqm)
            row = {"trainer": trainer, "core": core, "arm": name, "targets": len(own), "seeds": len(scores)}
            rows.append(row | {"iqm": stats.iqm(scores), "iqm_low": low, "iqm_high": high})
    return rows
