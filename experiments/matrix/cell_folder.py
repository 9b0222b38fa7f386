"""A matrix on disk: a folder `cells/<hash of its configuration>` for every run, what is in it, and what is wrong with it."""

from __future__ import annotations

import csv
import functools
import itertools
import math
from collections.abc import Collection, Iterable, Mapping
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from experiments.matrix.arms import ZERO_ACTION
from experiments.matrix.grid import Cell, identify
from transferkit.errors import RunDirectoryError
from transferkit.run.directory import ALWAYS, CHECKPOINT, POLICY, RECORD, RESULT, TABLES, read_json
from transferkit.run.files import check_state, write_atomically

CELL, ERROR = "cell.json", "error.txt"
EVALUATIONS = "evaluations.csv"
CELLS, SET_ASIDE = "cells", "damaged"
NAMES = ("id", "core", "member", "target", "arm", "trainer", "algo", "preset", "seed")
MEASURED = ("episodes", "steps", "seconds", "eval_return_mean", "eval_return_std", "eval_episodes")
VERSIONS = ("transferkit", "mujoco", "gymnasium", "torch")
RUN_FILES = (RECORD, RESULT, POLICY, "episodes.csv", EVALUATIONS, "model.csv")
"""What a finished run is; the rest is its checkpoint and logs."""

READ = {"episodes": ("episode", "steps", "return"), "evaluations": ("episodes", "steps", "return_mean")}
"""Columns of a run's tables that reports read."""

STATED = {
    "eval_return_mean": "return_mean",
    "eval_return_std": "return_std",
    "eval_episodes": "n",
    "steps": "steps",
    "episodes": "episodes",
}
"""What a result repeats of its last evaluation."""


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
        return _cell_problem(cell, where.name) or _run_problem(where / "run", trained=cell["arm"] != ZERO_ACTION)
    except (RunDirectoryError, OSError) as error:
        return str(error).partition(";")[0].replace(f"{where}/", "").replace(f"{where} holds", "it holds")
    except (ValueError, TypeError, AttributeError, csv.Error) as error:
        return f"{type(error).__name__}: {error}"


def _cell_problem(cell: Mapping[str, Any], name: str) -> str:
    if lacking := _lacking(CELL, cell, (*NAMES, "command", "config")):
        return lacking
    config = cell["config"]
    named = [config[key] for key in ("env", "member", "algo", "preset", "seed")]
    if (
        identify(cell["arm"], cell["core"], config) != name
        or [cell[key] for key in ("target", "member", "algo", "preset", "seed")] != named
    ):
        return f"{CELL} describes another run than its folder's name"
    return ""


def _run_problem(run: Path, *, trained: bool) -> str:
    if (run / RECORD).exists():
        record = read_json(run / RECORD)
        if lacking := _lacking(RECORD, record, ("git", "versions")):
            return lacking
        _made_by(record)
    if (run / RESULT).exists():
        return _result_problem(run, trained=trained)
    if (run / CHECKPOINT).exists():
        check_state(run / CHECKPOINT)
    if (run.parent / ERROR).exists():
        (run.parent / ERROR).read_text()
    return ""


def _lacking(file: str, found: Collection[str], names: Iterable[str]) -> str:
    lacking = {*names} - {*found}
    return f"{file} has no {min(lacking)}" if lacking else ""


def _result_problem(run: Path, *, trained: bool) -> str:
    result = read_json(run / RESULT)
    if lacking := _lacking(RESULT, result, MEASURED):
        return lacking
    for name in MEASURED:
        if not math.isfinite(result[name]):
            return f"{RESULT} says {name}={result[name]}"
    return _training_problem(run, result) if trained else ""


def _training_problem(run: Path, result: Mapping[str, Any]) -> str:
    for name in (RECORD, POLICY):
        if not (run / name).exists():
            return f"{name} is missing"
    check_state(run / POLICY)
    for name in ALWAYS:
        table = columns(run, name)
        if lacking := _lacking(f"{name}.csv", table, TABLES[name]):
            return lacking
        if not all(np.isfinite(table[column]).all() for column in READ[name]):
            return f"{name}.csv has a number that is not finite"
    last = {name: values[-1:].tolist() for name, values in columns(run, "evaluations").items()}
    if any(last[column] != [result[name]] for name, column in STATED.items()):
        return f"{EVALUATIONS} does not end with the evaluation that {RESULT} states"
    if len(columns(run, "episodes")["return"]) != result["episodes"]:
        return f"episodes.csv has not the {result['episodes']} returns that {RESULT} counts"
    return ""


def set_damaged_aside(out: Path, damaged: Mapping[Path, str]) -> list[str]:
    """Move cells whose files are damaged out of the way, so that they run again; one line about each."""
    lines = []
    for where, what in damaged.items():
        names = (out / SET_ASIDE / f"{where.name}.{k}" for k in itertools.count())
        copy = next(name for name in names if not name.exists())
        copy.parent.mkdir(exist_ok=True)
        where.rename(copy)
        lines.append(f"{where} is damaged ({what}); moved to {copy}; a run of the grid is made again")
    return lines


def cell_folders(out: Path) -> list[Path]:
    """Every cell that was ever started, in the order of its name; a start killed before it wrote anything is none."""
    return sorted({path.parent for name in (CELL, "run") for path in (out / CELLS).glob(f"*/{name}")})


def problems(out: Path) -> dict[Path, str]:
    """What is wrong with the files of each cell where something is."""
    return {where: what for where in cell_folders(out) if (what := problem(where))}


def made_by(run: Path) -> dict[str, str]:
    """Commit and versions that a run was made with."""
    return _made_by(read_json(run / RECORD))


def _made_by(record: Mapping[str, Any]) -> dict[str, str]:
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
    """The files of a cell by their path, without checkpoint and logs, to send to another machine."""
    names = (CELL, ERROR, *(f"run/{name}" for name in RUN_FILES))
    return {name: (where / name).read_bytes() for name in names if (where / name).exists()}


def unpack(where: Path, files: dict[str, bytes]) -> None:
    """The inverse of `pack`, the result last: with it a run counts as finished."""
    for name in sorted(files, key=lambda name: name.endswith(RESULT)):
        (where / name).parent.mkdir(parents=True, exist_ok=True)
        write_atomically(where / name, files[name])
