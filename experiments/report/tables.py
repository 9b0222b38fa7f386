"""Numbers of a report as rows, for the page and for CSV files."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import numpy as np

from experiments.arms import ZERO_ACTION
from experiments.report.data import Arm, Array, Group, Matrix
from experiments.verdict import SCRATCH, TRANSFER, paired
from transferkit import stats
from transferkit.zoo.card import read_card
from transferkit.zoo.catalog import find_core

HALFWAY = 0.5
"""The threshold of time to threshold, on the scale from zero action (0) to the upper reference (1)."""


def arm_rows(group: Group) -> list[dict[str, Any]]:
    """One row for every arm of a comparison."""
    return [_arm_row(group, arm) for arm in group.arms.values()]


def _arm_row(group: Group, arm: Arm) -> dict[str, Any]:
    low, high = stats.iqm_interval(arm.returns)
    row = {
        "target": group.target,
        "trainer": group.trainer,
        "core": group.core,
        "arm": arm.name,
        "n": len(arm.returns),
        "iqm": stats.iqm(arm.returns),
        "iqm_low": low,
        "iqm_high": high,
        "mean": float(arm.returns.mean()),
        "normalized": (float(arm.returns.mean()) - group.low) / (group.high - group.low),
        "difference": None,
        "difference_low": None,
        "difference_high": None,
        "p_better": None,
    }
    return row | (_against(group, arm.name) if arm.name not in (TRANSFER, ZERO_ACTION) and TRANSFER in group.scores else {})


def _against(group: Group, arm: str) -> dict[str, float]:
    """Transfer minus this arm in pairs, and the probability that a run of the transfer beats one of it."""
    usable = paired(group.scores, (TRANSFER, arm))
    if usable[arm].shape[1] < 2:
        return {}
    found = group.verdict.controls.get(arm) or stats.paired_difference(usable[TRANSFER], usable[arm])
    better, _, _ = stats.probability_of_improvement(usable[TRANSFER], usable[arm])
    return {"difference": found.mean, "difference_low": found.low, "difference_high": found.high, "p_better": better}


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
                found[group.target, group.trainer, name, "" if name == SCRATCH else group.core] = rows
    return [_paper_row(*key, rows) for key, rows in found.items()]


def _paper_row(target: str, trainer: str, arm: str, core: str, rows: list[Mapping[str, Any]]) -> dict[str, Any]:
    last, everything = (np.array([row[name] for row in rows], float) for name in ("last_50_mean", "all_mean"))
    low, high = stats.mean_interval(last)
    return {
        "target": target,
        "trainer": trainer,
        "arm": arm,
        "core": core,
        "n": len(rows),
        "last_50": float(last.mean()),
        "last_50_low": low,
        "last_50_high": high,
        "last_50_std": float(last.std(ddof=1)) if len(last) > 1 else 0.0,
        "last_50_median": float(np.median(last)),
        "last_50_edited": float(np.mean([row["last_50_edited"] for row in rows])),
        "all": float(everything.mean()),
        "seconds": float(np.mean([row["seconds"] for row in rows])),
        "steps": float(np.mean([row["steps"] for row in rows])),
    }
