"""`make bench`: how a matrix scales from one worker to two, and what a cell costs beside its training."""

from __future__ import annotations

import statistics
import subprocess
import sys
import tempfile
import time
from pathlib import Path

from experiments.matrix.cell_folder import problems
from experiments.matrix.table import ended

GRID = """
steps = 20000
cores = ["inverted-pendulum-v1"]
targets = ["InvertedDoublePendulum-v5"]
arms = ["transfer", "scratch"]
seeds = "0-11"
"""
ORDERS = ((1, 2), (2, 1))
"""Workers of the parts of each round; turned, so that a machine that slows down or speeds up favours neither."""


def main() -> None:
    """Measure and print."""
    rounds = [{workers: measure(workers) for workers in order} for order in ORDERS]
    scaling = [each[1][0] / each[2][0] for each in rounds]
    slowed = [each[2][1] / each[1][1] for each in rounds]
    overhead = [(each[1][0] - each[1][1]) / each[1][2] for each in rounds]
    print(f"24 cells: 2 workers are {spread(scaling)} times as fast as 1 (must be 1.9)")
    print(f"  the training of a cell itself takes {spread(slowed)} times as long beside another, so at best 2 divided by it")
    print(f"  a cell costs {spread(overhead)} s beside its training (must be 3)")


def measure(workers: int) -> tuple[float, float, int]:
    """Seconds of the whole command, start and plan included; of the training in it, over all cells; and how many cells."""
    with tempfile.TemporaryDirectory() as scratch:
        grid, out = Path(scratch) / "grid.toml", Path(scratch) / "out"
        grid.write_text(GRID)
        command = [sys.executable, "-m", "experiments.matrix", str(grid), "--out", str(out), "--workers", str(workers)]
        started = time.perf_counter()
        subprocess.run(command, check=True, stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL)
        seconds = time.perf_counter() - started
        rows, _ = ended(out, problems(out))
    return seconds, sum(row["seconds"] for row in rows), len(rows)


def spread(values: list[float]) -> str:
    """Median and range."""
    return f"{statistics.median(values):.2f} ({min(values):.2f} to {max(values):.2f})"


if __name__ == "__main__":
    main()
