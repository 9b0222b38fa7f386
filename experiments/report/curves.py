"""Final evaluations and learning curves of an arm's runs."""

from __future__ import annotations

import functools
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from experiments.matrix.run_table import columns
from transferkit import stats
from transferkit.errors import DivergedError, NotFiniteError
from transferkit.run import EpisodeRow, EvaluationRow

if TYPE_CHECKING:
    from experiments.matrix.table import Row

POINTS = 80
"""Points of a learning curve in the page."""

RESAMPLES = 200
"""For the intervals of a curve, which are drawn and not read off."""

DIVERGED = (DivergedError.__name__, NotFiniteError.__name__)
"""Errors that say something of the policy; others, as a full disk, do not."""

Key = tuple[int, int]
"""Member and seed of a run."""

WINDOWS = {"50-episode mean": 50, "each episode": 1}
"""The paper's smoothing, and none."""

EVALUATIONS, CORE_PLAYS = "evaluations", "share of runs that the untrained core plays"
KINDS = (*WINDOWS, EVALUATIONS, CORE_PLAYS)
"""What is drawn over time; the last two need evaluations during training."""

AXES = ("episodes", "steps")

Array = NDArray[np.float64]


@dataclass(frozen=True)
class Curve:
    """Interquartile mean over runs with its pointwise 95 % interval, up to the end of the first of them; each `(points,)`.

    Of what is a share already, the mean.
    """

    n: int
    """Runs."""
    x: Array
    middle: Array
    low: Array
    high: Array


@dataclass(frozen=True, eq=False)
class Arm:
    """All runs of an arm on one target under one trainer."""

    name: str
    rows: Sequence[Row]
    root: Path | None
    """Folder of the matrix's cells; None if only rows are here."""
    failed: Sequence[Row] = ()
    """Runs that have no result, though they were tried."""

    @property
    def diverged(self) -> list[Row]:
        """Failed runs whose training went wrong, and does so again with the same seed."""
        return [row for row in self.failed if row.error_kind in DIVERGED]

    @property
    def returns(self) -> Array:
        """Final evaluation of every run."""
        return np.array([row.eval_return_mean for row in self.rows])

    @functools.cached_property
    def episodes(self) -> dict[Key, dict[str, Array]]:
        """For every trained run that is here its training returns and the environment steps at the end of each episode."""
        tables = {_key(row): columns(run, EpisodeRow) for row, run in self._kept if row.episodes}
        return {key: {"returns": t["return"], "episodes": t["episode"], "steps": t["steps"]} for key, t in tables.items()}

    @functools.cached_property
    def evaluations(self) -> dict[Key, dict[str, Array]]:
        """For every run that is here and was evaluated more than once, those evaluations."""
        tables = {_key(row): columns(run, EvaluationRow) for row, run in self._kept if row.steps}
        return {
            key: {"returns": t["return_mean"], "core": t["core"], "episodes": t["episodes"], "steps": t["steps"]}
            for key, t in tables.items()
            if len(t["steps"]) > 1
        }

    def curve(self, kind: str, axis: str) -> Curve | None:
        """Training returns smoothed over a window, or one of evaluations, on the axis of episodes or of environment steps.

        The share of runs that the untrained core plays is none if it plays in no run.
        """
        return _curve(self, kind, axis)

    @property
    def _kept(self) -> list[tuple[Row, Path]]:
        """Runs whose folders are here, not only their rows."""
        if self.root is None:
            return []
        runs = [(row, self.root / row.id / "run") for row in self.rows]
        return [(row, run) for row, run in runs if run.exists()]


@functools.cache
def _curve(arm: Arm, kind: str, axis: str) -> Curve | None:
    grid = _crossed(arm.episodes if kind in WINDOWS else arm.evaluations)
    runs = [run for row in grid for run in row]
    if kind == CORE_PLAYS and not any(run["core"].any() for run in runs):
        return None
    values_of, statistic = ("core", np.mean) if kind == CORE_PLAYS else ("returns", stats.iqm)
    start, end = max((run[axis][0] for run in runs), default=0), min((run[axis][-1] for run in runs), default=0)
    if start >= end:
        return None
    x = np.linspace(start, end, POINTS)
    window = WINDOWS.get(kind, 1)
    values = np.array([[np.interp(x, run[axis], running_mean(run[values_of], window)) for run in row] for row in grid])
    low, high = stats.crossed_band(values, statistic, resamples=RESAMPLES)
    return Curve(len(runs), x, statistic(values.reshape(-1, POINTS), axis=0), low, high)


def running_mean(values: Array, window: int) -> Array:
    """Mean of the last `window` values up to each one; of fewer at the start."""
    padded = np.concatenate([np.full(window - 1, np.nan), values])
    windows = np.lib.stride_tricks.sliding_window_view(padded, window)
    return np.nanmean(windows, axis=1)  # differences of sums would keep the rounding of a diverged run


def _key(row: Row) -> Key:
    return row.member, row.seed


def _crossed(runs: Mapping[Key, dict[str, Array]]) -> list[list[dict[str, Array]]]:
    """The runs by member and seed, over the seeds that every member has."""
    members = sorted({member for member, _ in runs})
    seeds = [seed for seed in sorted({seed for _, seed in runs}) if all((member, seed) in runs for member in members)]
    return [[runs[member, seed] for seed in seeds] for member in members]
