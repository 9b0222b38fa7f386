"""How many runs a grid has, and how long they will take."""

from __future__ import annotations

import math
import tempfile
from collections import defaultdict
from collections.abc import Callable, Iterable, Sequence
from concurrent.futures import ThreadPoolExecutor
from contextlib import closing
from dataclasses import asdict, dataclass, replace
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from experiments.matrix.run_table import columns
from transferkit.envs import episode_limit, make_env
from transferkit.run import EpisodeRow
from transferkit.table import format_table
from transferkit.training import run_training

if TYPE_CHECKING:
    from experiments.matrix.cell import Cell
    from experiments.matrix.table import Row
    from transferkit.config import TrainConfig

TRIAL_SECONDS = 3.0
"""Training time of a trial, if no finished run tells how long one takes."""

Kind = tuple[object, ...]
"""What a run's time depends on: target, trainer, preset, whether there is a core, budget, device."""

Range = tuple[float, float]
"""Seconds, at least and at most."""


@dataclass(frozen=True)
class Pace:
    """What a trial shows."""

    first: float
    """Mean steps of the first episodes."""
    longest: float
    """Steps of an episode of full length."""
    seconds: float
    """Training time of a step."""

    def of(self, config: TrainConfig) -> Range:
        """What a run takes if its episodes stay as long as the first ones, and if all are of full length."""
        return self._of(config, self.first), self._of(config, self.longest)

    def _of(self, config: TrainConfig, length: float) -> float:
        steps = min((config.episodes or math.inf) * length, config.steps or math.inf)
        return min(steps * self.seconds, config.seconds or math.inf)


def plan(
    cells: Sequence[Cell], todo: Sequence[Cell], done: Sequence[Row], workers: int, trial: Callable[[Cell], Pace] | None = None
) -> str:
    """A line for every target and trainer, by finished runs of the same kind, or by a trial of a few seconds."""
    known, waiting, lines, total = _known(done), {cell.id for cell in todo}, [], np.zeros(2)
    groups: dict[tuple[str, str], list[Cell]] = defaultdict(list)
    for cell in cells:
        if cell.trained:  # else it takes no time
            groups[cell.config.env, cell.trainer].append(cell)
    for names, members in groups.items():
        left = [cell for cell in members if cell.id in waiting]
        new = [cell for cell in left if _kind(cell.row) not in known]
        pace, source = _try(max(new, key=lambda cell: cell.core != ""), trial or try_out) if new else (None, "")
        each = [known.get(_kind(cell.row)) or (pace and pace.of(cell.config)) for cell in left]
        times = np.array([time for time in each if time]).reshape(-1, 2)
        total += times.sum(axis=0)
        sources = ["finished runs"] * (len(new) < len(left)) + [source] * bool(new)
        mean = f"{_range(times.mean(axis=0))} s" if len(times) else ""
        lines.append((*names, str(len(members)), str(len(left)), mean, ", ".join(sources)))
    table = format_table(("target", "trainer", "runs", "to do", "each", "by"), lines)
    minutes = f"about {_range(total / workers / 60)} minutes of training with {workers} workers"
    return f"{table}\n{len(cells)} runs, {len(todo)} to do; {minutes}"


def try_out(cell: Cell) -> Pace:
    """Train a cell for a few seconds.

    A policy that learns not to fall has longer episodes, so what a budget of episodes takes is known only between two bounds.
    """
    trusting = replace(cell.config.wrap, probation=0)
    config = replace(
        cell.config, episodes=None, steps=None, seconds=TRIAL_SECONDS, eval_episodes=1, eval_every=0, wrap=trusting
    )
    with tempfile.TemporaryDirectory() as scratch, ThreadPoolExecutor(1) as thread:  # training leaves Ctrl-C alone in a thread
        out = Path(scratch) / "trial"
        result = thread.submit(run_training, config, out=out).result()
        finished = columns(out, EpisodeRow)
    pace = result.seconds / result.steps
    late = finished["seconds"] > result.seconds / 2  # a model-based trainer begins with steps in which it does not learn
    if late.any() and (steps := np.ptp(finished["steps"][late])):
        pace = max(pace, float(np.ptp(finished["seconds"][late]) / steps))
    with closing(make_env(config.env, **asdict(config.env_config))) as env:
        longest = episode_limit(env) or result.steps
    return Pace(min(longest, result.steps / result.episodes) if result.episodes else longest, longest, pace)


def _try(cell: Cell, trial: Callable[[Cell], Pace]) -> tuple[Pace | None, str]:
    """The pace of a trial, and what to call it."""
    try:
        return trial(cell), f"a trial of {TRIAL_SECONDS:.0f} s"
    except Exception as error:  # that run will fail by itself; others need not
        return None, f"nothing: a trial failed ({error})"


def _known(done: Sequence[Row]) -> dict[Kind, Range]:
    """Mean time of the finished runs of each kind."""
    times = defaultdict(list)
    for row in done:
        times[_kind(row)].append(row.seconds)
    means = {kind: float(np.mean(found)) for kind, found in times.items()}
    return {kind: (mean, mean) for kind, mean in means.items()}


def _kind(row: Row) -> Kind:
    return row.target, row.trainer, row.preset, row.core != "", row.budget, row.device


def _range(seconds: Iterable[float]) -> str:
    low, high = (f"{value:.0f}" for value in seconds)
    return low if low == high else f"{low} to {high}"
