"""What a report leaves on the disk: the page, and its figures and tables in a folder beside it."""

from __future__ import annotations

import sys
import time
from pathlib import Path

from experiments.report.comparisons import load_matrix
from experiments.report.page import write_page
from experiments.report.figures import draw_all
from experiments.report.tables import aggregate_rows, arm_rows, curve_rows, reproduction_rows, verdict_rows
from experiments.matrix.table import write_csv
from transferkit.errors import RunDirectoryError

TABLES = ("runs", "arms", "verdicts", "aggregates", "curves", "paper_measures")
WRITTEN = (*(f"{name}.csv" for name in TABLES), "curves_*.png", "curves_*.svg", "profiles.png", "profiles.svg")
"""What an earlier report may have left in its folder."""


def report(results: Path, out: Path) -> None:
    """Write everything, and say what was written.

    Raises:
        RunDirectoryError: there is nothing to report, or the page cannot be written.
    """
    started = time.monotonic()
    matrix = load_matrix(results)
    folder = _empty_folder(out)
    pictures = draw_all(matrix, folder)
    found = {
        "runs": [{name: value for name, value in row.items() if name != "label"} for row in (*matrix.rows, *matrix.failed)],
        "arms": [row for group in matrix.groups for row in arm_rows(group)],
        "verdicts": verdict_rows(matrix),
        "aggregates": aggregate_rows(matrix),
        "curves": [row for group in matrix.groups for row in curve_rows(group)],
        "paper_measures": reproduction_rows(matrix),
    }
    tables = [folder / f"{name}.csv" for name in TABLES if found[name]]
    for path in tables:
        write_csv(path, found[path.stem])
    write_page(matrix, pictures, tables, out)
    if matrix.damaged:
        count, first = len(matrix.damaged), matrix.damaged[0]
        print(f"{count} damaged, in no table (the page names them; {first}): run the matrix again", file=sys.stderr)
    print(f"{out}: {len(matrix.rows)} runs, {time.monotonic() - started:.1f} s; figures and tables in {folder}")


def _empty_folder(out: Path) -> Path:
    """The folder beside the page, without what an earlier report left in it."""
    if out.exists() and not (out.is_file() or out.is_dir()):
        raise RunDirectoryError(f"{out} is no file that could be replaced; pass another, as --out report.html")
    if out.is_dir():
        raise RunDirectoryError(f"{out} is a folder; pass a file, as --out {out / 'report.html'}")
    folder = out.with_name(f"{out.stem}_files")
    try:
        folder.mkdir(parents=True, exist_ok=True)
        for pattern in WRITTEN:
            for path in folder.glob(pattern):
                path.unlink()
    except OSError as error:
        raise RunDirectoryError(f"{folder} cannot be written ({error.strerror}); pass another --out FILE") from None
    return folder
