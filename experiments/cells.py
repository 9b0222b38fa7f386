"""A matrix on disk: a folder `cells/<hash of its configuration>` for every run, what is in it, and what is wrong with it."""

from __future__ import annotations

import csv
import functools
import itertools
import math
from collections.abc import Mapping
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from experiments.arms import ZERO_ACTION
from experiments.grid import Cell, identify
from transferkit.errors import RunDirectoryError
from transferkit.run.directory import CHECKPOINT, RECORD, RESULT, read_json
from transferkit.run.files import load_state, write_atomically

CELL, ERROR = "cell.json", "error.txt"
EVALUATIONS = "evaluations.csv"
CELLS, SET_ASIDE = "cells", "damaged"
NAMES = ("id", "core", "member", "target", "arm", "trainer", "algo", "preset", "seed")
MEASURED = ("episodes", "steps", "seconds", "eval_return_mean", "eval_return_std", "eval_episodes")
VERSIONS = ("transferkit", "mujoco", "gymnasium", "torch")
SMALL = (CELL, ERROR, f"run/{RECORD}", f"run/{RESULT}", "run/episodes.csv", f"run/{EVALUATIONS}", "run/model.csv")
"""What tables and reports need of a cell; the rest is checkpoints and logs."""


def folder(out: Path, cell: Cell) -> Path:
    """Where a cell lies: what it is, its run directory in `run`, and its error if it has failed."""
    return out / CELLS / cell.id


def finished(out: Path, cell: Cell) -> Path:
    """The result of a cell's run, where it has one."""
    return folder(out, cell) / "run" / RESULT


def problem(where: Path) -> str:
    """What is wrong with the files of a cell, finished or not; empty where nothing is."""
    try:
        cell = read_json(where / CELL)
        lacking = {*NAMES, "command"} - {*cell}
        if lacking:
            return f"{CELL} has no {min(lacking)}"
        if identify(cell["arm"], cell["core"], cell["config"]) != where.name:
            return f"{CELL} describes another run than its folder's name"
        run = where / "run"
        if (run / RECORD).exists():
            made_by(run)
        if (run / RESULT).exists():
            return _result_problem(run, trained=cell["arm"] != ZERO_ACTION)
        if (run / CHECKPOINT).exists():
            load_state(run / CHECKPOINT)
    except RunDirectoryError as error:
        return str(error).partition(";")[0]
    except (OSError, ValueError, KeyError, TypeError) as error:
        return f"{type(error).__name__}: {error}"
    return ""


def _result_problem(run: Path, *, trained: bool) -> str:
    result = read_json(run / RESULT)
    for name in MEASURED:
        if not math.isfinite(result[name]):
            return f"{RESULT} says {name}={result[name]}"
    if not trained:
        return ""
    if not (run / RECORD).exists():
        return f"{RECORD} is missing"
    if result["eval_return_mean"] not in columns(run, "evaluations")["return_mean"][-1:]:
        return f"{EVALUATIONS} does not end with the evaluation that {RESULT} states"
    returns = columns(run, "episodes")["return"]
    if len(returns) != result["episodes"] or not np.isfinite(returns).all():
        return f"episodes.csv has not the {result['episodes']} finite returns that {RESULT} counts"
    return ""


def set_damaged_aside(out: Path, damaged: Mapping[Path, str]) -> list[str]:
    """Move cells whose files are damaged out of the way, so that they run again; one line about each."""
    lines = []
    for where, what in damaged.items():
        names = (out / SET_ASIDE / f"{where.name}.{k}" for k in itertools.count())
        copy = next(name for name in names if not name.exists())
        copy.parent.mkdir(exist_ok=True)
        where.rename(copy)
        lines.append(f"{where} is damaged ({what}); moved to {copy}, and its run is made again")
    return lines


def cell_folders(out: Path) -> list[Path]:
    """Every cell that was ever started, in the order of its name; a start killed before it wrote anything is none."""
    return sorted({path.parent for name in (CELL, "run") for path in (out / CELLS).glob(f"*/{name}")})


def problems(out: Path) -> dict[Path, str]:
    """What is wrong with the files of each cell where something is."""
    return {where: what for where in cell_folders(out) if (what := problem(where))}


def made_by(run: Path) -> dict[str, str]:
    """Commit and versions that a run was made with."""
    record = read_json(run / RECORD)
    return {"commit": (record["git"] or {}).get("commit", ""), **{name: record["versions"].get(name, "") for name in VERSIONS}}


def columns(run: Path, name: str) -> dict[str, NDArray[np.float64]]:
    """A table of a run by column, `(rows,)` each; read once as long as the file stays the same."""
    path = run / f"{name}.csv"
    stat = path.stat()
    return _columns(path, stat.st_mtime_ns, stat.st_size, stat.st_ino)


@functools.lru_cache(maxsize=10_000)
def _columns(path: Path, *_version: int) -> dict[str, NDArray[np.float64]]:
    with path.open(newline="") as file:
        header, *rows = csv.reader(file)
    return dict(zip(header, np.array(rows, float).reshape(-1, len(header)).T, strict=True))


def pack(where: Path) -> dict[str, bytes]:
    """The small files of a cell by their path, to send to another machine."""
    return {name: (where / name).read_bytes() for name in SMALL if (where / name).exists()}


def unpack(where: Path, files: dict[str, bytes]) -> None:
    """The inverse of `pack`, the result last: with it a run counts as finished."""
    for name in sorted(files, key=lambda name: name.endswith(RESULT)):
        (where / name).parent.mkdir(parents=True, exist_ok=True)
        write_atomically(where / name, files[name])
