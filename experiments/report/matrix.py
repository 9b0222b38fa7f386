"""A matrix as a report shows it: its comparisons, and what else the page says of its runs."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING

from experiments.matrix.cell_folder import CELL, CELLS, CellFile
from experiments.matrix.results import read_results
from experiments.matrix.table import VERSIONS, ambiguity
from experiments.report.comparisons import compare
from experiments.report.ladder import ORDER
from transferkit.errors import RunDirectoryError
from transferkit.files import read_json

if TYPE_CHECKING:
    from experiments.matrix.results import Results
    from experiments.matrix.table import Row
    from experiments.report.comparisons import Group


@dataclass(frozen=True)
class Matrix:
    """Everything that a report shows."""

    rows: Sequence[Row]
    """Runs that finished."""
    groups: Sequence[Group]
    failed: Sequence[Row]
    damaged: Sequence[str]
    commands: Sequence[str]
    versions: Sequence[str]
    """Every set of versions and commit that runs were made with."""


def load_matrix(root: Path) -> Matrix:
    """Read a matrix; damaged cells are named, and stay out of everything else.

    Raises:
        RunDirectoryError: no folder is there, or no finished run in it.
    """
    if not root.is_dir():
        raise RunDirectoryError(f"{root} is not a folder", remedy="pass one that `python -m experiments.matrix` wrote")
    results = read_results(root)
    if not results.finished:
        remedy = "make some with `python -m experiments.matrix`"
        raise RunDirectoryError(f"{root} holds no finished run{_failures(results)}", remedy=remedy)
    if what := ambiguity(results.rows):
        remedy = "give each a trainer name of its own, or report them from folders of their own"
        raise RunDirectoryError(f"{root} holds {what}", remedy=remedy)
    paths = (root / CELLS / row.id / CELL for row in results.finished)
    made_by = {tuple(f"{name} {getattr(row, name)}" for name in (*VERSIONS, "commit")) for row in results.finished if row.torch}
    return Matrix(
        results.finished,
        sorted(compare(results.rows, root / CELLS), key=lambda group: ORDER.index(group.rung)),
        results.failed,
        [f"{where.name}: {what}" for where, what in results.damaged.items()],
        sorted({read_json(path, CellFile).command for path in paths if path.exists()}),
        [", ".join(names) for names in sorted(made_by)],
    )


def _failures(results: Results) -> str:
    if not results.failed:
        return ""
    first = results.failed[0]
    return f" and {len(results.failed)} failed ones ({first.error_kind}: {first.error})"
