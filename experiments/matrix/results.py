"""A matrix as tables: a row for every run that ended, and one for each evaluation.

A table can stand for runs whose folders are gone: what `known/*.csv` in a matrix's folder lists enters tables and reports,
without curves, and what finished is not run again.
"""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING

from experiments.matrix.arms import UNTRAINED, WITHOUT_CORE, WITHOUT_MEMBER
from experiments.matrix.cell_folder import CELLS, DamagedError, cell_folders, read_cell
from experiments.matrix.run_table import columns
from experiments.matrix.table import CURVE_COLUMNS, read_rows, write_csv, write_rows
from transferkit.errors import RunDirectoryError
from transferkit.run import EvaluationRow

if TYPE_CHECKING:
    from experiments.matrix.table import Row

TABLE, EVALUATIONS, KNOWN = "cells.csv", "evaluations.csv", "known"


@dataclass(frozen=True)
class Results:
    """What a matrix's folder holds."""

    rows: list[Row]
    """Every run that ended, sorted by id, so that their order does not depend on when they ran."""
    damaged: dict[Path, str]
    """Folders of cells that are damaged, and what is wrong with each."""

    @property
    def finished(self) -> list[Row]:
        """Runs that have a result."""
        return [row for row in self.rows if row.finished]

    @property
    def failed(self) -> list[Row]:
        """Runs that failed when they were last tried."""
        return [row for row in self.rows if not row.finished]


def read_results(out: Path) -> Results:
    """Read every cell and every table of known runs.

    Raises:
        RunDirectoryError: a table of known runs is damaged, or a run finished twice with two scores.
    """
    rows: dict[str, Row] = {}
    damaged: dict[Path, str] = {}
    if (out / KNOWN).is_file():
        raise RunDirectoryError(f"{out / KNOWN} is a file", remedy="make it a folder, and put the table into it as a .csv")
    for path in sorted((out / KNOWN).glob("*.csv")):
        for row in read_rows(path):
            _add(rows, row, path)
    for where in cell_folders(out):
        try:
            row = read_cell(where)
        except DamagedError as error:
            damaged[where] = error.what
        else:
            if row is not None:
                _add(rows, row, where)
    check_consistent(rows.values(), out)
    return Results([rows[key] for key in sorted(rows)], damaged)


def collect(out: Path) -> list[Row]:
    """Write the table of all runs that ended, and that of their evaluations; returns the rows of those that finished."""
    results = read_results(out)
    if results.rows:
        write_rows(out / TABLE, results.rows)
    if curves := evaluations(out, results.finished):
        write_csv(out / EVALUATIONS, curves)
    return results.finished


def evaluations(out: Path, rows: Iterable[Row]) -> list[dict[str, object]]:
    """Every evaluation of those of these runs that are here, not only known."""
    found = []
    for row in rows:
        run = out / CELLS / row.id / "run"
        if EvaluationRow.file(run).exists():
            table = columns(run, EvaluationRow)
            points = zip(*(table[name].tolist() for name in CURVE_COLUMNS[1:]), strict=True)
            for steps, episodes, *others in points:
                found.append(dict(zip(CURVE_COLUMNS, (row.id, int(steps), int(episodes), *others), strict=True)))
    return found


def check_consistent(rows: Iterable[Row], path: Path) -> None:
    """Refuse rows of a core where an arm has none, and a run that is there under two ids.

    Raises:
        RunDirectoryError: there is one.
    """
    places: dict[object, str] = {}
    for row in rows:
        bare = row.arm in WITHOUT_CORE or row.arm in UNTRAINED
        if bare == bool(row.core) or (row.member and row.arm in WITHOUT_MEMBER):
            what = f"core {row.core or 'none'}, member {row.member}"
            raise RunDirectoryError(f"{path} has a run of the arm {row.arm} with {what}", remedy="mend or remove it")
        place = row.target, row.trainer, row.arm, row.core, row.member, row.seed, row.budget, row.settings
        if (other := places.setdefault(place, row.id)) != row.id:
            run = f"{row.arm} on {row.target} with seed {row.seed}"
            raise RunDirectoryError(f"{path} has the run {run} as {other} and as {row.id}", remedy="keep one")


def _add(rows: dict[str, Row], row: Row, where: Path) -> None:
    """Add a row; what finished stays, whatever else is said of the same run."""
    earlier = rows.get(row.id)
    if earlier and earlier.finished and row.finished and earlier.eval_return_mean != row.eval_return_mean:
        scores = f"{earlier.eval_return_mean} and {row.eval_return_mean}"
        raise RunDirectoryError(f"{where} has run {row.id} with another score than before it ({scores})", remedy="keep one")
    if earlier is None or not earlier.finished:
        rows[row.id] = row
