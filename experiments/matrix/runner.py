"""The runs of a grid: each in a process and a folder of its own, here or on a Ray cluster."""

from __future__ import annotations

import os
import shlex
import sys
import tempfile
import time
from collections.abc import Mapping, Sequence
from concurrent.futures import as_completed
from concurrent.futures.process import BrokenProcessPool
from dataclasses import asdict, dataclass
from functools import partial
from pathlib import Path
from typing import Any

import torch

from experiments.matrix.arms import ARMS, WITHOUT_CORE, ZERO_ACTION
from experiments.matrix.cell_folder import CELL, CELLS, ERROR, finished, folder, problems, set_damaged_aside
from experiments.matrix.ray_pool import connect, ray_pool
from experiments.matrix.grid import Cell
from experiments.matrix.grid_toml import load_cells
from experiments.matrix.estimate import plan
from experiments.matrix.table import TABLE, collect, ended
from transferkit.config import TrainConfig
from transferkit.envs import make_env
from transferkit.errors import ConfigError, Interrupted, RunInUseError
from transferkit.evaluation import ZeroPolicy, evaluate
from transferkit.policy import Policy
from transferkit.run.directory import read_json
from transferkit.run.files import write_atomically, write_json
from transferkit.run.workers import GRACE, import_beside, worker_pool
from transferkit.transfer import run_training
from transferkit.zoo.artifact import load_core

PATIENCE = 2 * GRACE
"""Seconds to wait for a run that another process is writing."""


@dataclass(frozen=True)
class Outcome:
    """What became of a cell."""

    cell: Cell
    error: str = ""
    """Empty where it finished."""


def run(grid: Path, out: Path, *, workers: int = 2, ray: str | None = None, dry_run: bool = False) -> int:
    """Run what is not done, or only print the plan; returns 1 where a cell failed, else 0.

    Raises:
        ConfigError: the grid, the output folder or the cluster is wrong.
        RunDirectoryError: a table of known runs is damaged.
    """
    if workers < 1:
        raise ConfigError(f"workers={workers} must be at least 1; pass --workers")
    if out.exists() and not out.is_dir():
        raise ConfigError(f"{out} is no folder; pass another --out DIR")
    cells = load_cells(grid)
    workers = workers if ray is None else connect(ray)
    damaged = problems(out)
    if dry_run:
        lines = [f"{where} is damaged ({what}); without --dry-run it is moved aside" for where, what in damaged.items()]
    else:
        lines = tidy(out, cells, damaged)
    for line in lines:
        print(line, file=sys.stderr)
    done, _ = ended(out, damaged)
    known = {row["id"] for row in done}
    todo = [cell for cell in cells if cell.id not in known]
    if todo and ray is None and not dry_run:
        import_beside("experiments.arms", "transferkit.ppo", "transferkit.dyna")  # while the plan tries how fast a run is
    print(plan(cells, todo, done, workers), flush=True)
    if dry_run:
        return 0
    failed = run_all(todo, out, workers, on_ray=ray is not None)
    print(f"{len(collect(out))} finished runs in {out / TABLE}")
    for outcome in failed:
        print(describe(outcome, out), file=sys.stderr)
    if failed:
        print(f"{len(failed)} of {len(cells)} runs failed; the same command tries them again", file=sys.stderr)
    return 1 if failed else 0


def tidy(out: Path, cells: Sequence[Cell], damaged: Mapping[Path, str]) -> list[str]:
    """Make the folder, move what is damaged aside, and give known cells the names that the grid has for them now.

    Returns:
        A line about each damaged cell.

    Raises:
        ConfigError: the folder cannot be written.
    """
    place = out
    try:
        (out / CELLS).mkdir(parents=True, exist_ok=True)
        for place in (out, out / CELLS):
            tempfile.TemporaryFile(dir=place).close()
        lines = set_damaged_aside(out, damaged)
    except OSError as error:
        raise ConfigError(f"{place} cannot be written ({error.strerror}); pass another --out DIR") from None
    for cell in cells:
        path = folder(out, cell) / CELL
        if path.exists() and (known := read_json(path)) != (named := {**known, **cell.row}):
            write_json(path, named)
    return lines


def run_all(cells: Sequence[Cell], out: Path, workers: int, *, on_ray: bool = False) -> list[Outcome]:
    """Run cells in processes of their own, here or on the Ray cluster that is connected; returns those that failed."""
    started, failed = time.monotonic(), []
    job = partial(run_cell, out=out.absolute(), command=shlex.join(("python", "-m", "experiments.matrix", *sys.argv[1:])))
    with ray_pool(out) if on_ray else worker_pool(workers, len(cells)) as pool:
        waiting = {pool.submit(job, cell): cell for cell in cells}
        for done, future in enumerate(as_completed(waiting), 1):
            error = future.exception()
            if isinstance(error, BrokenProcessPool):
                raise error
            outcome = future.result() if error is None else Outcome(waiting[future], f"{type(error).__name__}: {error}")
            failed += [outcome] if outcome.error else []
            left = (time.monotonic() - started) / done * (len(cells) - done)
            print(f"{done} of {len(cells)}, {left / 60:.0f} min left: {describe(outcome, out)}", file=sys.stderr, flush=True)
    return failed


def run_cell(cell: Cell, out: Path, command: str) -> Outcome:
    """Run one cell in its folder, going on where it stopped; an error is written there and returned, not raised."""
    torch.set_num_threads(1)  # from the first network on, so that a cell's bits do not depend on what ran before it
    where = folder(out, cell)
    where.mkdir(parents=True, exist_ok=True)
    write_json(where / CELL, {"id": cell.id, **cell.row, "command": command, "config": asdict(cell.config)})
    (where / ERROR).unlink(missing_ok=True)  # of an earlier try
    try:
        if cell.arm == ZERO_ACTION:
            finished(out, cell).parent.mkdir(exist_ok=True)
            write_json(finished(out, cell), evaluate_nothing(cell))
        else:
            arm = WITHOUT_CORE[cell.arm] if cell.arm in WITHOUT_CORE else partial(ARMS[cell.arm], core=load_core(cell.core))
            config, policy = arm(cell.config)
            train_when_free(config, policy, where / "run")
    except Interrupted:
        os._exit(0)  # told to stop: the pool would hand this process the next run
    except RunInUseError as error:  # which is not this process's to judge
        return Outcome(cell, f"{type(error).__name__}: {error}")
    except Exception as error:  # one broken run must not end the others
        write_atomically(where / ERROR, f"{type(error).__name__}: {error}\n".encode())
        return Outcome(cell, f"{type(error).__name__}: {error}")
    return Outcome(cell)


def train_when_free(config: TrainConfig, policy: Policy, out: Path) -> None:
    """Train, and wait first for a worker of a killed matrix that is still saving this run."""
    deadline = time.monotonic() + PATIENCE
    while True:
        try:
            run_training(config, policy=policy, out=out, resume=True)
        except RunInUseError:
            if time.monotonic() > deadline:
                raise
            time.sleep(0.2)
        else:
            return


def evaluate_nothing(cell: Cell) -> dict[str, Any]:
    """The result of a run that never acts."""
    env = make_env(cell.config.env)
    dims = env.action_space.shape
    env.close()
    assert dims is not None
    scores = evaluate(ZeroPolicy(dims[0]), cell.config.env, episodes=cell.config.eval_episodes).row()
    score = {f"eval_{name}": scores[name] for name in ("return_mean", "return_std")}
    return {"episodes": 0, "steps": 0, "seconds": 0.0, **score, "eval_episodes": cell.config.eval_episodes}


def describe(outcome: Outcome, out: Path) -> str:
    """One line about a cell that ended."""
    row = outcome.cell.row
    member = f" member {row['member']}" if row["core"] else ""
    name = " ".join(filter(None, (row["arm"], row["core"] + member, row["target"], row["trainer"], f"seed {row['seed']}")))
    if outcome.error:
        return f"{name} FAILED: {outcome.error}"
    return f"{name}: {read_json(finished(out, outcome.cell))['eval_return_mean']:.1f}"
