"""Numbers of a report as rows, for the page and for CSV files."""

from __future__ import annotations

import functools
from collections.abc import Mapping
from typing import Any

import numpy as np

from experiments.arms import WITHOUT_CORE, ZERO_ACTION
from experiments.report.data import Arm, Array, Group, Matrix
from experiments.verdict import SCRATCH, TRANSFER, paired
from transferkit import stats
from transferkit.zoo.card import read_card
from transferkit.zoo.catalog import find_core

HALFWAY = 0.5
"""The threshold of time to threshold, on the scale from zero action (0) to the upper reference (1)."""


@functools.cache
def arm_rows(group: Group) -> list[dict[str, Any]]:
    """One row for every arm of a comparison."""
    return [_arm_row(group, arm) for arm in group.arms.values()]


def _arm_row(group: Group, arm: Arm) -> dict[str, Any]:
    low, high = _mean_interval(group, arm.name, "eval_return_mean")
    row = {
        "target": group.target,
        "trainer": group.trainer,
        "core": group.core,
        "arm": arm.name,
        "n": len(arm.returns),
        "iqm": stats.iqm(arm.returns),
        "mean": float(arm.returns.mean()),
        "mean_low": low,
        "mean_high": high,
        "normalized": float(group.normalized(arm.returns).mean()),
        "difference": None,
        "difference_low": None,
        "difference_high": None,
        "corrected": None,
        "p_better": None,
    }
    return row | (_against(group, arm.name) if arm.name not in (TRANSFER, ZERO_ACTION) and TRANSFER in group.scores else {})


def _mean_interval(group: Group, name: str, measure: str) -> tuple[float, float]:
    """Of the mean over members and seeds, both resampled; over the seeds that every member has."""
    if name == ZERO_ACTION:
        value = group.arms[name].rows[0][measure]
        return value, value
    values = group.grid(name, measure)
    complete = values[:, np.isfinite(values).all(axis=0)]
    return stats.crossed_interval(complete) if complete.size else (float("nan"), float("nan"))


def _against(group: Group, arm: str) -> dict[str, float]:
    """Transfer minus this arm in pairs, and the probability that a run of the transfer beats one of it."""
    usable = paired(group.scores, (TRANSFER, arm))
    if usable[arm].shape[1] < 2:
        return {}
    found = group.verdict.controls.get(arm) or stats.paired_difference(usable[TRANSFER], usable[arm])
    better, _, _ = stats.probability_of_improvement(usable[TRANSFER], usable[arm])
    return {
        "difference": found.mean,
        "difference_low": found.low,
        "difference_high": found.high,
        "corrected": arm in group.verdict.controls,
        "p_better": better,
    }


@functools.cache
def curve_rows(group: Group) -> list[dict[str, Any]]:
    """Taylor and Stone's measures of transfer and scratch by their evaluations; empty without evaluations during training."""
    arms = {name: group.arms[name].evaluations for name in (TRANSFER, SCRATCH) if name in group.arms}
    if len(arms) < 2 or not all(arms.values()):
        return []
    threshold = group.low + HALFWAY * (group.high - group.low)
    reached = {
        name: [stats.steps_to_threshold(run["steps"], run["returns"], threshold) for run in runs] for name, runs in arms.items()
    }
    efficiency = {
        "data_efficiency": stats.data_efficiency(reached[SCRATCH], reached[TRANSFER]),
        "data_efficiency_total": stats.data_efficiency(reached[SCRATCH], reached[TRANSFER], source=source_steps(group.core)),
    }
    return [
        {"target": group.target, "trainer": group.trainer, "core": group.core, "arm": name, "threshold": threshold}
        | _measures(runs, reached[name])
        | (efficiency if name == TRANSFER else dict.fromkeys(efficiency))
        for name, runs in arms.items()
    ]


def _measures(runs: list[Mapping[str, Array]], reached: list[float]) -> dict[str, Any]:
    return {
        "before_training": float(np.mean([run["returns"][0] for run in runs])),
        "area": float(np.mean([stats.area(run["steps"], run["returns"]) for run in runs])),
        "asymptote": float(np.mean([stats.asymptote(run["steps"], run["returns"]) for run in runs])),
        "steps_to_threshold": float(np.median(reached)),
        "never_reached": int(np.isinf(reached).sum()),
    }


def source_steps(core: str) -> float:
    """Environment steps that a member of the core cost, on average."""
    return float(np.mean([spent["steps"] for spent in read_card(find_core(core)).spent]))


def verdict_rows(matrix: Matrix) -> list[dict[str, Any]]:
    """One row for every core, target and trainer with a core."""
    return [
        {
            "target": group.target,
            "trainer": group.trainer,
            "core": group.core,
            "verdict": group.verdict.kind,
            "reason": group.verdict.reason,
            "transfer_minus_scratch": group.verdict.scratch and group.verdict.scratch.mean,
            "normalized": group.normalized_difference,
        }
        for group in matrix.groups
        if group.core
    ]


def reproduction_rows(matrix: Matrix) -> list[dict[str, Any]]:
    """The paper's own measures for every arm: mean training return of the last 50 episodes, and of all, over runs."""
    found = {}
    for group in matrix.groups:
        for name, arm in group.arms.items():
            rows = [row for row in arm.rows if row["last_50_mean"] != ""]
            if rows:
                found[group.target, group.trainer, name, "" if name in WITHOUT_CORE else group.core] = _paper_row(
                    group, name, rows
                )
    return list(found.values())


def _paper_row(group: Group, name: str, rows: list[Mapping[str, Any]]) -> dict[str, Any]:
    last, everything = (np.array([row[measure] for row in rows], float) for measure in ("last_50_mean", "all_mean"))
    low, high = _mean_interval(group, name, "last_50_mean")
    edited_low, edited_high = _mean_interval(group, name, "last_50_edited")
    return {
        "target": group.target,
        "trainer": group.trainer,
        "arm": name,
        "core": "" if name in WITHOUT_CORE else group.core,
        "n": len(rows),
        "last_50": float(last.mean()),
        "last_50_low": low,
        "last_50_high": high,
        "last_50_std": float(last.std(ddof=1)) if len(last) > 1 else 0.0,
        "last_50_median": float(np.median(last)),
        "last_50_edited": float(np.mean([row["last_50_edited"] for row in rows])),
        "last_50_edited_low": edited_low,
        "last_50_edited_high": edited_high,
        "all": float(everything.mean()),
        "seconds": float(np.mean([row["seconds"] for row in rows])),
        "steps": float(np.mean([row["steps"] for row in rows])),
    }
