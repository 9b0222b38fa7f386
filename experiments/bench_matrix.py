"""`make bench`: how a matrix scales from one worker to two, and what a cell costs beside its training."""

from __future__ import annotations

import statistics
import subprocess
import sys
import tempfile
import time
from pathlib import Path

from experiments.cells import problems, table

GRID = """
steps = 40000
cores = ["inverted-pendulum-v1"]
targets = ["InvertedDoublePendulum-v5"]
arms = ["transfer", "scratch"]
seeds = "0-3"
"""
ROUNDS = 2


def main() -> None:
    """Measure and print."""
    ratios, overheads = [], []
    for _ in range(ROUNDS):
        (one, own), (two, _) = measure(1), measure(2)
        ratios.append(one / two)
        overheads.append(own)
    print(
        f"8 cells: 2 workers are {statistics.median(ratios):.2f} times as fast as 1 ({min(ratios):.2f} to {max(ratios):.2f}; "
        f"must be 1.9); a cell costs {statistics.median(overheads):.1f} s beside its training ({min(overheads):.1f} to "
        f"{max(overheads):.1f}; must be 3)"
    )


def measure(workers: int) -> tuple[float, float]:
    """Seconds of the whole command, start and plan included, and a cell's share of them that is no training."""
    with tempfile.TemporaryDirectory() as scratch:
        grid, out = Path(scratch) / "grid.toml", Path(scratch) / "out"
        grid.write_text(GRID)
        command = [sys.executable, "-m", "experiments.matrix", str(grid), "--out", str(out), "--workers", str(workers)]
        started = time.perf_counter()
        subprocess.run(command, check=True, capture_output=True)
        seconds = time.perf_counter() - started
        rows = table(out, problems(out))
    return seconds, (seconds * workers - sum(row["seconds"] for row in rows)) / len(rows)


if __name__ == "__main__":
    main()
