"""A matrix as tables: a row for every run that ended, and one for each evaluation.

A table can stand for runs whose folders are gone: what `known/*.csv` in a matrix's folder lists enters tables and reports,
without curves, and what finished is not run again.
"""

from __future__ import annotations

import csv
import io
import math
from collections import Counter, defaultdict
from collections.abc import Collection, Iterable, Iterator, Mapping, Sequence
from dataclasses import asdict
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from experiments.arms import ZERO_ACTION
from experiments.cells import (
    CELL,
    CELLS,
    ERROR,
    EVALUATIONS,
    MEASURED,
    NAMES,
    VERSIONS,
    cell_folders,
    columns,
    made_by,
    problems,
)
from experiments.grid import Cell, settings
from transferkit.errors import RunDirectoryError
from transferkit.run.directory import RECORD, RESULT, read_json
from transferkit.run.files import write_atomically

TABLE, KNOWN = "cells.csv", "known"
LAST = 50
"""Episodes at the end whose mean return is the paper's measure."""

EDITED = -10.0
"""What stands for every return of 0 or less in the paper's released data of PPO on Hopper."""

PAPER_MEASURES = ("last_50_mean", "last_50_edited", "all_mean")
BUDGETS = ("budget_episodes", "budget_steps", "budget_seconds")
SETTINGS = ("setting", "wrapping")
COLUMNS = (*NAMES, *BUDGETS, *MEASURED, *PAPER_MEASURES, "commit", *VERSIONS, "error", *SETTINGS)
LATER = ("error", *SETTINGS)
"""Columns that tables of earlier versions lack."""

NUMBERS = (*BUDGETS, *MEASURED, *PAPER_MEASURES)

Row = dict[str, Any]


def collect(out: Path) -> list[Row]:
    """Write the table of all runs that ended, and that of evaluations; returns the rows of those that finished."""
    finished, failed = ended(out, problems(out))
    for name, found in ((TABLE, finished + failed), (EVALUATIONS, evaluations(out, finished))):
        if found:
            write_csv(out / name, found)
    return finished


def ended(out: Path, damaged: Collection[Path]) -> tuple[list[Row], list[Row]]:
    """Rows of the runs that finished, and of those that failed when they were last tried, intact or known.

    Their order does not depend on when they ran.

    Raises:
        RunDirectoryError: a table of known runs is damaged.
    """
    rows = _known_rows(out)
    for where in cell_folders(out):
        if where not in damaged and ((where / "run" / RESULT).exists() or (where / ERROR).exists()):
            _merge(rows, _row(where), where)
    ordered = sorted(rows.values(), key=lambda row: row["id"])
    return [row for row in ordered if not row["error"]], [row for row in ordered if row["error"]]


def identity(cell: Cell) -> Row:
    """What the row of a cell says before it has run."""
    return _identity(cell.row, asdict(cell.config))


def _identity(names: Mapping[str, Any], config: Mapping[str, Any]) -> Row:
    return {**names, **{name: config.get(name.removeprefix("budget_")) for name in BUDGETS}, **settings(config)}


def _row(where: Path) -> Row:
    cell, row = read_json(where / CELL), dict.fromkeys(COLUMNS, "")
    row |= _identity({name: cell[name] for name in NAMES}, cell["config"])
    if not (where / "run" / RESULT).exists():
        made = made_by(where / "run") if (where / "run" / RECORD).exists() else {}
        return row | made | {"error": (where / ERROR).read_text().strip() or "unknown"}
    result = read_json(where / "run" / RESULT)
    row |= {name: result[name] for name in MEASURED}
    if cell["arm"] == ZERO_ACTION:
        return row
    returns = columns(where / "run", "episodes")["return"]
    edited = np.where(returns[-LAST:] <= 0, EDITED, returns[-LAST:])
    means = dict(zip(PAPER_MEASURES, map(_mean, (returns[-LAST:], edited, returns)), strict=True))
    return row | means | made_by(where / "run")


def _mean(returns: NDArray[np.float64]) -> float | str:
    return round(float(np.mean(returns)), 3) if len(returns) else ""


def _known_rows(out: Path) -> dict[str, Row]:
    """The rows of all tables of known runs, by id."""
    rows: dict[str, Row] = {}
    if (out / KNOWN).is_file():
        raise RunDirectoryError(f"{out / KNOWN} is a file; make it a folder, and put the table into it as a .csv")
    for path in sorted((out / KNOWN).glob("*.csv")):
        for row in _read(path):
            _merge(rows, row, path)
    return rows


def _merge(rows: dict[str, Row], row: Row, where: Path) -> None:
    """Add a row; of a run that failed once and finished once, the latter stays.

    Raises:
        RunDirectoryError: it finished twice, with two scores.
    """
    earlier = rows.get(row["id"])
    if earlier is None or earlier["error"] or (not row["error"] and row["eval_return_mean"] == earlier["eval_return_mean"]):
        rows[row["id"]] = row
    elif not row["error"]:
        scores = f"{earlier['eval_return_mean']} and {row['eval_return_mean']}"
        raise RunDirectoryError(f"{where} has run {row['id']} with another score than before it ({scores}); keep one of them")


def _read(path: Path) -> Iterator[Row]:
    """The rows of a table that `collect` wrote, with the types that they had; earlier ones had no errors."""
    fix = f"put a {TABLE} there as a matrix wrote it, or remove the file"
    try:
        with path.open(newline="", encoding="utf-8-sig") as file:
            reader = csv.DictReader(file)
            lacking = [name for name in COLUMNS if name not in (*LATER, *(reader.fieldnames or ()))]
            if lacking:
                raise RunDirectoryError(f"{path} has no column {lacking[0]}; {fix}")
            for row in reader:
                try:
                    yield _typed({**dict.fromkeys(LATER, ""), **row})
                except ValueError:
                    raise RunDirectoryError(f"{path}, line {reader.line_num}, is no run that ended; {fix}") from None
    except (OSError, UnicodeError, csv.Error) as error:
        raise RunDirectoryError(f"{path} is no table ({error}); {fix}") from None


def _typed(row: Mapping[str | None, str | None]) -> Row:
    """With numbers where they belong.

    Raises:
        ValueError: a cell too many or too few, no number where one must be, or one that is not finite.
    """
    if None in row or None in row.values():
        raise ValueError(row)
    typed: Row = {name: row[name] for name in COLUMNS} | {name: int(row[name] or "") for name in ("member", "seed")}
    wanted = ("id", "target", "arm", *(() if row["error"] else MEASURED))
    if not all(typed[name] for name in wanted):
        raise ValueError(row)
    for name in NUMBERS:
        if typed[name]:
            typed[name] = int(typed[name]) if typed[name].isdecimal() else float(typed[name])
            if not math.isfinite(typed[name]):
                raise ValueError(typed[name])
        elif name in BUDGETS:
            typed[name] = None
    return typed


def label(row: Mapping[str, Any]) -> str:
    """The trainer's name in a report, with its preset where that is not the default."""
    return row["trainer"] if row["preset"] == "default" else f"{row['trainer']} ({row['preset']} preset)"


def ambiguity(rows: Iterable[Row]) -> str:
    """What one name stands for twice, so that no table could tell it apart; empty where nothing does.

    One trainer on one target has one budget and one setting, and builds cores in in one way; what tables of earlier versions
    do not say of that is not compared.
    """
    meanings: dict[tuple[str, str, str], set[Any]] = defaultdict(set)
    runs: Counter[str] = Counter()
    for row in rows:
        if row["arm"] != ZERO_ACTION:
            meanings[row["target"], label(row), "budget"].add(tuple(row[name] for name in BUDGETS))
            for name in SETTINGS:
                meanings[row["target"], label(row), name] |= {row[name]} - {""}
        names = {"trainer": label(row)} | {name: row[name] for name in ("target", "core", "arm", "member", "seed")}
        runs[", ".join(f"{name} {value}" for name, value in names.items() if value != "")] += 1
    for (target, trainer, what), found in meanings.items():
        if len(found) > 1:
            return f"runs of {trainer} on {target} with {len(found)} {what}s"
    return next((f"{count} runs of {what}, with different settings" for what, count in runs.items() if count > 1), "")


def evaluations(out: Path, rows: Sequence[Row]) -> list[Row]:
    """A row for every evaluation of those of these runs whose folders are here, with what tells the run."""
    found = []
    for row in rows:
        path = out / CELLS / row["id"] / "run" / EVALUATIONS
        if path.exists():
            with path.open(newline="") as file:
                found += [{name: row[name] for name in NAMES} | evaluation for evaluation in csv.DictReader(file)]
    return found


def write_csv(path: Path, rows: list[Row]) -> None:
    """Rows that have the same keys, as a file that is there or not there."""
    text = io.StringIO()
    writer = csv.DictWriter(text, list(rows[0]), lineterminator="\n")
    writer.writeheader()
    writer.writerows(rows)
    write_atomically(path, text.getvalue().encode())
