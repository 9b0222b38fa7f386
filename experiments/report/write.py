"""Files of a report: the page, and its figures and tables in a folder beside it."""

from __future__ import annotations

import sys
import time
from pathlib import Path

from experiments.matrix.table import write_csv, write_rows
from experiments.report.figures import draw_all
from experiments.report.matrix import load_matrix
from experiments.report.page import write_page
from experiments.report.tables import aggregate_rows, arm_rows, curve_rows, paper_rows, verdict_rows
from transferkit.errors import RunDirectoryError, printable

TABLES = ("runs", "arms", "verdicts", "aggregates", "curves", "paper_measures")
WRITTEN = (*(f"{name}.csv" for name in TABLES), "curves_*.png", "curves_*.svg", "profiles.png", "profiles.svg")
"""Files that an earlier report may have left in its folder."""


def report(results: Path, out: Path) -> None:
    """Write everything, and say what was written.

    Raises:
        RunDirectoryError: there is nothing to report, or the page cannot be written.
    """
    started = time.monotonic()
    matrix = load_matrix(results)
    folder = _empty_folder(out)
    pictures = draw_all(matrix, folder)
    write_rows(folder / "runs.csv", (*matrix.rows, *matrix.failed))
    found = {
        "arms": [row for group in matrix.groups for row in arm_rows(group)],
        "verdicts": verdict_rows(matrix.groups),
        "aggregates": aggregate_rows(matrix.groups),
        "curves": [row for group in matrix.groups for row in curve_rows(group)],
        "paper_measures": paper_rows(matrix.groups),
    }
    tables = [folder / "runs.csv", *(folder / f"{name}.csv" for name in found if found[name])]
    for path in tables[1:]:
        write_csv(path, found[path.stem])
    write_page(matrix, pictures, tables, out)
    if matrix.damaged:
        count, first = len(matrix.damaged), matrix.damaged[0]
        print(f"{count} damaged, in no table (the page names them; {printable(first)}): run the matrix again", file=sys.stderr)
    print(f"{out}: {len(matrix.rows)} runs, {time.monotonic() - started:.1f} s; figures and tables in {folder}")


def _empty_folder(out: Path) -> Path:
    """The folder beside the page, without what an earlier report left in it."""
    if out.exists() and not (out.is_file() or out.is_dir()):
        raise RunDirectoryError(f"{out} is not a file that could be replaced", remedy="choose another {out}")
    if out.is_dir():
        raise RunDirectoryError(f"{out} is a folder", remedy="choose a file as {out}, such as report.html in it")
    folder = out.with_name(f"{out.stem}_files")
    try:
        folder.mkdir(parents=True, exist_ok=True)
        for pattern in WRITTEN:
            for path in folder.glob(pattern):
                path.unlink()
    except OSError as error:
        raise RunDirectoryError(f"{folder} cannot be written ({error.strerror})", remedy="choose another {out}") from None
    return folder
