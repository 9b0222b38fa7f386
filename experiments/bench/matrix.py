"""How a matrix scales from one worker to two, and what a cell costs beside its training."""

from __future__ import annotations

import subprocess
import sys
import tempfile
from dataclasses import dataclass
from pathlib import Path

from experiments.bench.timing import seconds, spread
from experiments.matrix.results import read_results

GRID = """
steps = {steps}
cores = ["inverted-pendulum-v1"]
targets = ["InvertedDoublePendulum-v5"]
arms = ["transfer", "scratch"]
seeds = "0-{last}"
"""


@dataclass(frozen=True)
class Size:
    """How much is measured."""

    steps: int
    last: int
    """Last seed; two cells each."""
    orders: tuple[tuple[int, int], ...]
    """Workers in the order of each round; turned, so that a machine that slows down or speeds up favours neither."""


FULL, TINY = Size(20_000, 11, ((1, 2), (2, 1))), Size(150, 0, ((1, 2),))


def main(size: Size) -> None:
    """Measure and print."""
    rounds = [{workers: measure(size, workers) for workers in order} for order in size.orders]
    scaling = [each[1][0] / each[2][0] for each in rounds]
    slowed = [each[2][1] / each[1][1] for each in rounds]
    overhead = [(each[1][0] - each[1][1]) / each[1][2] for each in rounds]
    print(f"{rounds[0][1][2]} cells: 2 workers are {spread(scaling)} times as fast as 1 (must be 1.9)")
    print(f"  the training of a cell itself takes {spread(slowed)} times as long beside another, so at best 2 divided by it")
    print(f"  a cell costs {spread(overhead)} s beside its training (must be 3)")


def measure(size: Size, workers: int) -> tuple[float, float, int]:
    """Seconds of the whole command, start and plan included; of the training in it, over all cells; and how many cells."""
    with tempfile.TemporaryDirectory() as scratch:
        grid, out = Path(scratch) / "grid.toml", Path(scratch) / "out"
        grid.write_text(GRID.format(steps=size.steps, last=size.last))
        command = [sys.executable, "-m", "experiments.matrix", str(grid), "--out", str(out), "--workers", str(workers)]
        quiet = subprocess.DEVNULL
        whole = seconds(lambda: subprocess.run(command, check=True, stdout=quiet, stderr=quiet))
        rows = read_results(out).finished
    return whole, sum(row.seconds for row in rows), len(rows)
