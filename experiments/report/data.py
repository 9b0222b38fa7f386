"""A matrix of runs in memory: scores and learning curves of every arm, by target, trainer and core."""

from __future__ import annotations

import functools
from collections import Counter
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from experiments.arms import WITHOUT_CORE, ZERO_ACTION
from experiments.cells import CELL, CELLS, columns, failures, problems, table
from experiments.references import best
from experiments.verdict import TRANSFER, Verdict, judge
from transferkit import stats
from transferkit.errors import RunDirectoryError
from transferkit.run.directory import RECORD, read_json

POINTS = 80
"""Of a learning curve in the page."""

RESAMPLES = 200
"""For the intervals of a curve, which are drawn and not read off."""

WINDOWS = {"50-episode mean": 50, "each episode": 1}
"""The paper's smoothing, and none."""

EVALUATIONS = "evaluations"
AXES = ("episodes", "steps")

Array = NDArray[np.float64]


@dataclass(frozen=True)
class Curve:
    """Interquartile mean over runs with its pointwise 95 % interval, up to where the first of them ends; each `(points,)`."""

    x: Array
    iqm: Array
    low: Array
    high: Array


@dataclass(frozen=True, eq=False)
class Arm:
    """All runs of an arm on one target under one trainer."""

    name: str
    rows: Sequence[Mapping[str, Any]]
    root: Path

    @property
    def returns(self) -> Array:
        """Final evaluation of every run."""
        return np.array([row["eval_return_mean"] for row in self.rows], float)

    @functools.cached_property
    def episodes(self) -> list[dict[str, Array]]:
        """For every trained run its training returns and the environment steps at the end of each episode."""
        tables = [columns(self._run(row), "episodes") for row in self.rows if row["episodes"]]
        return [{"returns": t["return"], "episodes": t["episode"], "steps": t["steps"]} for t in tables]

    @functools.cached_property
    def evaluations(self) -> list[dict[str, Array]]:
        """For every run that was evaluated more than once, those evaluations."""
        tables = [columns(self._run(row), EVALUATIONS) for row in self.rows if row["steps"]]
        return [
            {"returns": t["return_mean"], "episodes": t["episodes"], "steps": t["steps"]} for t in tables if len(t["steps"]) > 1
        ]

    @functools.cache  # noqa: B019 - arms live as long as the report
    def curve(self, kind: str, axis: str) -> Curve | None:
        """Training returns smoothed over a window, or evaluations, on the axis of episodes or of environment steps."""
        runs = self.evaluations if kind == EVALUATIONS else self.episodes
        if not runs:
            return None
        smoothed = [
            (run[axis], run["returns"] if kind == EVALUATIONS else running_mean(run["returns"], WINDOWS[kind])) for run in runs
        ]
        x = np.linspace(max(xs[0] for xs, _ in smoothed), min(xs[-1] for xs, _ in smoothed), POINTS)
        values = np.array([np.interp(x, xs, ys) for xs, ys in smoothed])
        resampled = values[np.random.default_rng(0).integers(len(values), size=(RESAMPLES, len(values)))]
        low, high = np.quantile(stats.iqm(resampled, axis=1), [0.025, 0.975], axis=0)
        return Curve(x, stats.iqm(values, axis=0), low, high)

    def _run(self, row: Mapping[str, Any]) -> Path:
        return self.root / CELLS / row["id"] / "run"


@dataclass(frozen=True, eq=False)
class Group:
    """A core on a target under a trainer, with every arm it is compared with."""

    target: str
    trainer: str
    core: str
    arms: Mapping[str, Arm]
    low: float
    """Return of the zero action, or 0 where it was not evaluated."""
    high: float
    high_source: str

    @functools.cached_property
    def scores(self) -> dict[str, Array]:
        """Final evaluations `(members, seeds)` of every trained arm over the seeds of all, NaN where a run is missing."""
        return {name: self.grid(name, "eval_return_mean") for name in self.arms if name != ZERO_ACTION}

    def grid(self, name: str, measure: str) -> Array:
        """A measure of an arm's runs, as `scores` has it."""
        rows = [row for arm, found in self.arms.items() if arm != ZERO_ACTION for row in found.rows]
        seeds = sorted({row["seed"] for row in rows})
        members = [0] if name in WITHOUT_CORE else sorted({row["member"] for row in rows if row["core"]})
        values = np.full((len(members), len(seeds)), np.nan)
        for row in self.arms[name].rows:
            values[members.index(row["member"]), seeds.index(row["seed"])] = row[measure]
        return values

    @functools.cached_property
    def verdict(self) -> Verdict:
        """What the comparison shows."""
        return judge(self.scores)

    @property
    def normalized_difference(self) -> float | None:
        """Transfer minus scratch, as a share of what lies between the references."""
        difference = self.verdict.scratch
        return None if difference is None else difference.mean / (self.high - self.low)

    def normalized(self, returns: Array) -> Array:
        """Returns on the scale from zero action (0) to the upper reference (1)."""
        return stats.normalized(returns, self.low, self.high)


@dataclass(frozen=True)
class Matrix:
    """Everything a report shows."""

    rows: Sequence[Mapping[str, Any]]
    groups: Sequence[Group]
    failed: Sequence[tuple[Mapping[str, Any], str]]
    damaged: Sequence[str]
    commands: Sequence[str]
    versions: Mapping[str, str]


def load_matrix(root: Path) -> Matrix:
    """Read a matrix; damaged cells are named, and stay out of everything else.

    Raises:
        RunDirectoryError: no finished run is there.
    """
    damaged = problems(root)
    rows = table(root, damaged)
    if not rows:
        raise RunDirectoryError(
            f"{root} holds no finished run; make some with `python -m experiments.matrix GRID --out {root}`"
        )
    labelled = [{**row, "label": label(row)} for row in rows]
    _check_single(labelled, root)
    commands = sorted({read_json(root / CELLS / row["id"] / CELL)["command"] for row in rows})
    first = next((row for row in rows if row["arm"] != ZERO_ACTION), None)
    versions = read_json(root / CELLS / first["id"] / "run" / RECORD)["versions"] if first else {}
    return Matrix(
        labelled,
        _groups(labelled, root),
        list(failures(root)),
        [f"{where.name}: {what}" for where, what in damaged.items()],
        commands,
        versions,
    )


def label(row: Mapping[str, Any]) -> str:
    """The trainer's name in a report, with its preset where that is not the default."""
    return row["trainer"] if row["preset"] == "default" else f"{row['trainer']} ({row['preset']} preset)"


def running_mean(values: Array, window: int) -> Array:
    """Mean of the last `window` values up to each one; of fewer at the start."""
    sums = np.cumsum(np.insert(values, 0, 0.0))
    ends = np.arange(1, len(values) + 1)
    starts = np.maximum(ends - window, 0)
    return (sums[ends] - sums[starts]) / (ends - starts)


def _groups(rows: Sequence[Mapping[str, Any]], root: Path) -> list[Group]:
    groups = []
    trained = [row for row in rows if row["arm"] != ZERO_ACTION]
    for target, trainer in sorted({(row["target"], row["label"]) for row in trained}):
        here = [row for row in trained if (row["target"], row["label"]) == (target, trainer)]
        idle = [row for row in rows if row["arm"] == ZERO_ACTION and row["target"] == target]
        cores = sorted({row["core"] for row in here if row["core"]}) or [""]
        low = idle[0]["eval_return_mean"] if idle else 0.0
        seen = max(row["eval_return_mean"] for row in rows if row["target"] == target)
        high, source = best(target, seen if seen > low else low + 1.0)
        for core in cores:
            own = [row for row in here if row["core"] in ("", core)] + idle
            names = sorted({row["arm"] for row in own}, key=_rank)
            arms = {name: Arm(name, [row for row in own if row["arm"] == name], root) for name in names}
            groups.append(Group(target, trainer, core, arms, low, high, source))
    return groups


def _rank(arm: str) -> tuple[int, str]:
    return (0 if arm == TRANSFER else 1 if arm == "scratch" else 3 if arm in (*WITHOUT_CORE, ZERO_ACTION) else 2, arm)


def _check_single(rows: Sequence[Mapping[str, Any]], root: Path) -> None:
    names = ("target", "label", "core", "arm", "member", "seed")
    for key, count in Counter(tuple(row[name] for name in names) for row in rows).items():
        if count > 1:
            what = ", ".join(f"{name} {value}" for name, value in zip(names, key, strict=True) if value != "")
            raise RunDirectoryError(
                f"{root} holds {count} runs of {what}, with different settings; give each setting a trainer name of its own, "
                "or report them from folders of their own"
            )
