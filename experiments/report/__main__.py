"""`python -m experiments.report runs/paper --out report.html`: a page, figures and tables of a matrix."""

from __future__ import annotations

import argparse
import sys
import time
from pathlib import Path

from experiments.report.data import load_matrix
from experiments.report.page import write_page
from experiments.report.pictures import draw_all
from experiments.report.tables import aggregate_rows, arm_rows, curve_rows, reproduction_rows, verdict_rows
from experiments.rows import write_csv
from transferkit.errors import RunDirectoryError, TransferkitError


def main() -> int:
    """Write the page, and beside it a folder `<page>_files` with figures (PNG, SVG) and tables (CSV)."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("results", type=Path, help="folder that `experiments.matrix --out` wrote")
    parser.add_argument("--out", type=Path, default=Path("report.html"))
    options = parser.parse_args()
    try:
        report(options.results, options.out)
    except (TransferkitError, OSError) as error:
        print(f"error: {error}", file=sys.stderr)
        return 2
    return 0


def report(results: Path, out: Path) -> None:
    """Write everything, and say what was written."""
    started = time.monotonic()
    if out.is_dir():
        raise RunDirectoryError(f"{out} is a folder; pass a file, as --out {out / 'report.html'}")
    matrix = load_matrix(results)
    folder = out.with_name(f"{out.stem}_files")
    pictures = draw_all(matrix, folder)
    found = {
        "runs": [{name: value for name, value in row.items() if name != "label"} for row in (*matrix.rows, *matrix.failed)],
        "arms": [row for group in matrix.groups for row in arm_rows(group)],
        "verdicts": verdict_rows(matrix),
        "aggregates": aggregate_rows(matrix),
        "curves": [row for group in matrix.groups for row in curve_rows(group)],
        "paper_measures": reproduction_rows(matrix),
    }
    tables = [folder / f"{name}.csv" for name, rows in found.items() if rows]
    for path in tables:
        write_csv(path, found[path.stem])
    write_page(matrix, pictures, tables, out)
    if matrix.damaged:
        count, first = len(matrix.damaged), matrix.damaged[0]
        print(f"{count} damaged, in no table (the page names them; {first}): run the matrix again", file=sys.stderr)
    print(f"{out}: {len(matrix.rows)} runs, {time.monotonic() - started:.1f} s; figures and tables in {folder}")


if __name__ == "__main__":
    sys.exit(main())
