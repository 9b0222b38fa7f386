"""How many runs a grid has, and how long they will take."""

from __future__ import annotations

import tempfile
from collections import defaultdict
from collections.abc import Mapping, Sequence
from concurrent.futures import ThreadPoolExecutor
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np

from experiments.arms import ZERO_ACTION
from experiments.grid import Cell
from transferkit.envs import episode_limit, make_env
from transferkit.table import format_table
from transferkit.transfer import run_training

TRIAL_SECONDS = 3.0
"""Of training, where no finished run tells how long one takes."""

Kind = tuple[str, str]
"""Target and trainer, which a run's time depends on."""


def plan(cells: Sequence[Cell], todo: Sequence[Cell], done: Sequence[Mapping[str, Any]], workers: int) -> str:
    """A line for every target and trainer, by rows of finished runs or, where there are none, by a trial of a few seconds."""
    known = defaultdict(list)
    for row in done:
        known[row["target"], row["trainer"]].append(float(row["seconds"]))
    groups: dict[Kind, list[Cell]] = defaultdict(list)
    for cell in cells:
        if cell.arm != ZERO_ACTION:  # which takes no time
            groups[cell.row["target"], cell.row["trainer"]].append(cell)
    waiting, rows, total = {cell.id for cell in todo}, [], 0.0
    for kind, members in groups.items():
        left = [cell for cell in members if cell.id in waiting]
        each = float(np.mean(known[kind])) if kind in known else trial(left[0]) if left else 0.0
        total += len(left) * each
        source = "finished runs" if kind in known else f"a trial of {TRIAL_SECONDS:.0f} s"
        rows.append((*kind, str(len(members)), str(len(left)), f"{each:.0f} s", source))
    lines = format_table(("target", "trainer", "runs", "to do", "each", "by"), rows)
    return f"{lines}\n{len(cells)} runs, {len(todo)} to do; about {total / workers / 60:.0f} minutes with {workers} workers"


def trial(cell: Cell) -> float:
    """Seconds that a run will take, if it goes on as fast, with episodes as long, as it begins.

    A policy that learns not to fall has longer episodes, so a budget of episodes alone may take longer.
    """
    config = replace(cell.config, core=None, episodes=None, steps=None, seconds=TRIAL_SECONDS, eval_episodes=1, eval_every=0)
    with tempfile.TemporaryDirectory() as scratch, ThreadPoolExecutor(1) as thread:  # where training leaves Ctrl-C alone
        result = thread.submit(run_training, config, out=Path(scratch) / "trial").result()
    per_step = result.seconds / result.steps
    if cell.config.episodes is None:
        steps = float("inf")
    elif result.episodes:
        steps = cell.config.episodes * result.steps / result.episodes
    else:
        steps = cell.config.episodes * (episode_limit(make_env(cell.config.env)) or result.steps)
    bounds = steps, cell.config.steps or float("inf")
    return min(min(bounds) * per_step, cell.config.seconds or float("inf"))
