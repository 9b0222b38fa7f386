"""A matrix as tables: a row for every finished run, and one for each of its evaluations.

A table can stand for runs whose folders are gone: what `known/*.csv` in a matrix's folder lists counts as finished, and enters
tables and reports, without curves.
"""

from __future__ import annotations

import csv
import io
import math
from collections.abc import Collection, Iterator, Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from experiments.arms import ZERO_ACTION
from experiments.cells import CELL, CELLS, EVALUATIONS, MEASURED, NAMES, VERSIONS, cell_folders, columns, made_by, problems
from transferkit.errors import RunDirectoryError
from transferkit.run.directory import RESULT, read_json
from transferkit.run.files import write_atomically

TABLE, KNOWN = "cells.csv", "known"
LAST = 50
"""Episodes at the end whose mean return is the paper's measure."""

EDITED = -10.0
"""What stands for every return of 0 or less in the paper's released data of PPO on Hopper."""

PAPER_MEASURES = ("last_50_mean", "last_50_edited", "all_mean")
BUDGETS = ("budget_episodes", "budget_steps", "budget_seconds")
COLUMNS = (*NAMES, *BUDGETS, *MEASURED, *PAPER_MEASURES, "commit", *VERSIONS)
NUMBERS = ("member", "seed", *BUDGETS, *MEASURED, *PAPER_MEASURES)


def collect(out: Path) -> list[dict[str, Any]]:
    """Write the table of all finished runs, which is returned, and that of their evaluations."""
    rows = table(out, problems(out))
    for name, found in ((TABLE, rows), (EVALUATIONS, evaluations(out, rows))):
        if found:
            write_csv(out / name, found)
    return rows


def table(out: Path, damaged: Collection[Path]) -> list[dict[str, Any]]:
    """A row for every finished run that is intact or known, in an order that does not depend on when they ran.

    Raises:
        RunDirectoryError: a table of known runs is damaged.
    """
    rows = {row["id"]: row for path in sorted((out / KNOWN).glob("*.csv")) for row in _known(path)}
    here = (where for where in cell_folders(out) if (where / "run" / RESULT).exists() and where not in damaged)
    rows |= {where.name: _row(where) for where in here}
    return sorted(rows.values(), key=lambda row: [str(row[name]) for name in row])


def _row(where: Path) -> dict[str, Any]:
    cell, result = read_json(where / CELL), read_json(where / "run" / RESULT)
    names = {name: cell[name] for name in NAMES} | {name: cell["config"].get(name.removeprefix("budget_")) for name in BUDGETS}
    measured = {name: result[name] for name in MEASURED}
    if cell["arm"] == ZERO_ACTION:
        return names | measured | dict.fromkeys((*PAPER_MEASURES, "commit", *VERSIONS), "")
    returns = columns(where / "run", "episodes")["return"]
    edited = np.where(returns[-LAST:] <= 0, EDITED, returns[-LAST:])
    means = dict(zip(PAPER_MEASURES, map(_mean, (returns[-LAST:], edited, returns)), strict=True))
    return names | measured | means | made_by(where / "run")


def _mean(returns: NDArray[np.float64]) -> float | str:
    return round(float(np.mean(returns)), 3) if len(returns) else ""


def _known(path: Path) -> Iterator[dict[str, Any]]:
    """The rows of a table that `collect` wrote, with the types that they had."""
    fix = f"put a {TABLE} there as a matrix wrote it, or remove the file"
    with path.open(newline="") as file:
        reader = csv.DictReader(file)
        lacking = [name for name in COLUMNS if name not in (reader.fieldnames or ())]
        if lacking:
            raise RunDirectoryError(f"{path} has no column {lacking[0]}; {fix}")
        for row in reader:
            try:
                if None in row.values():
                    raise ValueError
                yield {name: _number(name, row[name]) if name in NUMBERS else row[name] for name in COLUMNS}
            except (ValueError, TypeError):
                raise RunDirectoryError(f"{path}, line {reader.line_num}, is no finished run; {fix}") from None


def _number(name: str, text: str) -> float | str | None:
    if not text and name not in MEASURED:
        return None if name in BUDGETS else ""
    value = int(text) if text.isdecimal() else float(text)
    if not math.isfinite(value):
        raise ValueError(text)
    return value


def evaluations(out: Path, rows: Sequence[Mapping[str, Any]]) -> list[dict[str, Any]]:
    """A row for every evaluation of those of these runs whose folders are here, with what tells the run."""
    found = []
    for row in rows:
        path = out / CELLS / row["id"] / "run" / EVALUATIONS
        if path.exists():
            with path.open(newline="") as file:
                found += [{name: row[name] for name in NAMES} | evaluation for evaluation in csv.DictReader(file)]
    return found


def write_csv(path: Path, rows: list[dict[str, Any]]) -> None:
    """Rows that have the same keys, as a file that is there or not there."""
    text = io.StringIO()
    writer = csv.DictWriter(text, list(rows[0]), lineterminator="\n")
    writer.writeheader()
    writer.writerows(rows)
    write_atomically(path, text.getvalue().encode())
