"""Run a grid: each run in a process and a folder of its own, here or on a Ray cluster."""

from __future__ import annotations

import errno
import logging
import os
import shlex
import sys
import tempfile
import time
from collections.abc import Callable, Collection, Iterable, Iterator, Sequence
from concurrent.futures import as_completed
from concurrent.futures.process import BrokenProcessPool
from contextlib import contextmanager
from dataclasses import asdict, dataclass, replace
from functools import cache, partial
from pathlib import Path
from typing import TYPE_CHECKING

import torch

from experiments.matrix.arms import ARMS, UNTRAINED, WITHOUT_CORE
from experiments.matrix.cell_folder import CELL, CELLS, ERROR, CellFile, Scores, folder, set_aside
from experiments.matrix.estimate import plan
from experiments.matrix.evaluation import actor_without_policy, evaluate_untrained, write_speed
from experiments.matrix.grid_toml import load_cells
from experiments.matrix.ray_pool import connect, ray_pool
from experiments.matrix.results import TABLE, collect, read_results
from transferkit.errors import ConfigError, InterruptedRunError, RunDirectoryError, RunInUseError, printable
from transferkit.files import read_json, write_json
from transferkit.policy.saved import load_policy
from transferkit.run import RESULT, is_run, read_record
from transferkit.training import run_training
from transferkit.workers import GRACE, import_beside, worker_pool
from transferkit.zoo.artifact import load_core

if TYPE_CHECKING:
    from experiments.matrix.cell import Cell
    from experiments.matrix.results import Results
    from transferkit.config import TrainConfig
    from transferkit.envs import Actor
    from transferkit.policy.base import Policy

PATIENCE = 2 * GRACE
"""Seconds to wait for a run that another process is writing."""

FULL = (errno.ENOSPC, errno.EDQUOT)

Train = Callable[..., object]
"""`run_training`, or a stand-in."""


class FullDiskError(RunDirectoryError):
    """No fault of a run: until there is room, no other could be written either."""


@dataclass(frozen=True)
class Outcome:
    """What became of a cell."""

    cell: Cell
    score: float | None = None
    error_kind: str = ""
    """Empty if it finished."""
    error: str = ""

    def __str__(self) -> str:
        cell, config = self.cell, self.cell.config
        core = f"{cell.core} member {config.member}" if cell.core else ""
        name = " ".join(filter(None, (cell.arm, core, config.env, cell.trainer, f"seed {config.seed}")))
        outcome = f" FAILED: {self.error_kind}: {self.error}" if self.error_kind else f": {self.score:.1f}"
        return printable(f"{name}{outcome}")


def run(
    grid: Path, out: Path, *, workers: int = 2, ray: str | None = None, dry_run: bool = False, named: Collection[str] = ()
) -> int:
    """Run what is not done, or only print the plan; returns 1 if a cell failed, else 0.

    Targets that import a module must be `named`.

    Raises:
        ConfigError: the grid, the output folder or the cluster is wrong.
        RunDirectoryError: a table of known runs is damaged, or the disk is full.
    """
    if workers < 1:
        raise ConfigError("{workers}", value=workers, allowed="at least 1")
    if out.exists() and not out.is_dir():
        raise ConfigError(f"{out} is not a folder", remedy="choose another {out}")
    cells = load_cells(grid, named)
    workers = workers if ray is None else connect(ray)
    results = read_results(out)
    if not dry_run:
        make_folders(out)
    for line in damages(out, results, move=not dry_run):
        print(printable(line), file=sys.stderr)
    if not dry_run:
        rename(out, cells)
    done = {row.id for row in results.finished}
    check_cores(out, [cell for cell in cells if cell.id in done])
    todo = [cell for cell in cells if cell.id not in done]
    if todo and ray is None and not dry_run:
        # While the plan tries how fast a run is.
        import_beside("experiments.matrix.arms", "transferkit.trainers.ppo", "transferkit.trainers.dyna")
    print(plan(cells, todo, results.finished, workers), flush=True)
    if dry_run:
        return 0
    failed = run_all(todo, out, workers, on_ray=ray is not None)
    print(f"{len(collect(out))} finished runs in {out / TABLE}")
    for outcome in failed:
        print(outcome, file=sys.stderr)
    if failed:
        print(f"{len(failed)} of {len(cells)} runs failed; the same command tries them again", file=sys.stderr)
    return 1 if failed else 0


def make_folders(out: Path) -> None:
    """Make the matrix's folder, and check that it can be written."""
    place = out
    try:
        (out / CELLS).mkdir(parents=True, exist_ok=True)
        for place in (out, out / CELLS):
            tempfile.TemporaryFile(dir=place).close()
    except OSError as error:
        raise ConfigError(f"{place} cannot be written ({error.strerror})", remedy="choose another {out}") from None


def check_cores(out: Path, cells: Iterable[Cell]) -> None:
    """Refuse a core that is not the one of the runs that are here, though it has its name.

    Raises:
        ConfigError: there is one.
    """
    digest = cache(lambda name: load_core(name).digest)
    for cell in cells:
        path = folder(out, cell) / "run"
        recorded = read_record(path).get("core_digest") if cell.core and is_run(path) else None
        if recorded and recorded != digest(cell.core):
            raise ConfigError(f"{path} was run around another core with the name {cell.core}", remedy="choose another {out}")


def rename(out: Path, cells: Sequence[Cell]) -> None:
    """Give the cells that are here the trainers' names that the grid has now."""
    for cell in cells:
        path = folder(out, cell) / CELL
        if path.exists() and (known := read_json(path, CellFile)).trainer != cell.trainer:
            write_json(path, asdict(replace(known, trainer=cell.trainer)))


def damages(out: Path, results: Results, *, move: bool) -> list[str]:
    """A line about each damaged cell, which is moved aside to run again."""
    if not move:
        return [f"{where} is damaged ({what}); without --dry-run it is moved aside" for where, what in results.damaged.items()]
    return [f"{where} is damaged ({what}); moved to {set_aside(out, where)}" for where, what in results.damaged.items()]


def run_all(cells: Sequence[Cell], out: Path, workers: int, *, on_ray: bool = False) -> list[Outcome]:
    """Run cells in processes of their own, here or on the Ray cluster that is connected; returns those that failed."""
    started, failed = time.monotonic(), []
    job = partial(run_cell, out=out.absolute(), command=shlex.join(("python", "-m", "experiments.matrix", *sys.argv[1:])))
    with ray_pool(out.absolute()) if on_ray else worker_pool(workers, len(cells)) as pool:
        waiting = {pool.submit(job, cell): cell for cell in cells}
        for done, future in enumerate(as_completed(waiting), 1):
            error = future.exception()
            if isinstance(error, BrokenProcessPool | FullDiskError):
                for other in waiting:
                    other.cancel()
                raise error
            outcome = future.result() if error is None else failure(waiting[future], error)
            failed += [outcome] if outcome.error_kind else []
            left = (time.monotonic() - started) / done * (len(cells) - done)
            print(f"{done} of {len(cells)}, {left / 60:.0f} min left: {outcome}", file=sys.stderr, flush=True)
    return failed


def run_cell(cell: Cell, out: Path, command: str, *, train: Train = run_training) -> Outcome:
    """Run one cell in its folder, going on where it stopped; an error is written there and returned, not raised.

    Raises:
        FullDiskError: there is no room on the disk.
    """
    try:
        return _run_cell(cell, out, command, train)
    except (RunDirectoryError, OSError) as error:
        if not on_full_disk(error):
            raise
        what = error.what if isinstance(error, RunDirectoryError) else str(error)
        raise FullDiskError(what, remedy="make room on the disk; the same command goes on") from error


def on_full_disk(error: BaseException) -> bool:
    """Whether an error says that a disk has no room."""
    cause = error if isinstance(error, OSError) else error.__cause__
    return isinstance(cause, OSError) and cause.errno in FULL


def _run_cell(cell: Cell, out: Path, command: str, train: Train) -> Outcome:
    torch.set_num_threads(1)  # from the first network on, so that a cell's bits do not depend on what ran before it
    where = folder(out, cell)
    where.mkdir(parents=True, exist_ok=True)
    write_json(where / CELL, {**cell.to_json(), "command": command})
    (where / ERROR).unlink(missing_ok=True)  # of an earlier try
    try:
        finish(cell, where, train)
    except InterruptedRunError:
        os._exit(0)  # told to stop: the pool would hand this process the next run
    except RunInUseError as error:  # which is not this process's to judge
        return failure(cell, error)
    except Exception as error:  # one broken run must not end the others
        if on_full_disk(error):
            raise
        outcome = failure(cell, error)
        write_json(where / ERROR, {"kind": outcome.error_kind, "message": outcome.error})
        return outcome
    return Outcome(cell, read_json(where / "run" / RESULT, Scores).eval_return_mean)


def finish(cell: Cell, where: Path, train: Train) -> None:
    """Train and evaluate a cell, or only evaluate it if it has no budget."""
    run, config = where / "run", cell.config
    if cell.trained:
        config, policy = policy_of(cell)
        train_when_free(config, policy, run, train)
        actor: Actor = load_policy(run)
    else:
        actor = actor_without_policy(cell) if cell.arm in UNTRAINED else policy_of(cell)[1]
        evaluate_untrained(actor, config, run)
    write_speed(actor, config, where)


def policy_of(cell: Cell) -> tuple[TrainConfig, Policy]:
    """The configuration of an arm, and its untrained policy."""
    if cell.arm in WITHOUT_CORE:
        return WITHOUT_CORE[cell.arm](cell.config)
    return ARMS[cell.arm](cell.config, load_core(cell.core))


def train_when_free(config: TrainConfig, policy: Policy, out: Path, train: Train) -> None:
    """Train, and wait first for a worker of a killed matrix that is still saving this run."""
    deadline = time.monotonic() + PATIENCE
    while True:
        try:
            with without_words():
                train(config, policy=policy, out=out, resume=True)
        except RunInUseError:
            if time.monotonic() > deadline:
                raise
            time.sleep(0.2)
        else:
            return


@contextmanager
def without_words() -> Iterator[None]:
    """Keep a run from saying how it goes: it stands in the run's row, and hundreds of runs would bury the progress."""
    logger = logging.getLogger("transferkit")
    level = logger.level
    logger.setLevel(logging.ERROR)
    try:
        yield
    finally:
        logger.setLevel(level)


def failure(cell: Cell, error: BaseException) -> Outcome:
    """The outcome of a cell that raised."""
    return Outcome(cell, error_kind=type(error).__name__, error=str(error))
