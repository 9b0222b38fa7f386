"""`make bench`: how long the report of 1,000 runs takes; their numbers are made up, their files as large as real ones."""

from __future__ import annotations

import subprocess
import sys
import tempfile
import time
from dataclasses import asdict
from pathlib import Path

import numpy as np
import torch

from experiments.matrix.arms import ZERO_ACTION
from experiments.matrix.cell_folder import CELL, CELLS, MEASURED, STATED, problems
from experiments.matrix.grid import Cell
from experiments.matrix.grid_toml import load_cells
from experiments.matrix.table import write_csv
from transferkit.run.directory import POLICY, RECORD, RESULT, TABLES
from transferkit.run.files import save_state, write_json
from transferkit.versions import versions

GRID = Path(__file__).parent / "grids" / "first.toml"
RUNS, EPISODES, EVALUATIONS = 1000, 200, 5


def main() -> None:
    """Measure and print."""
    with tempfile.TemporaryDirectory() as scratch:
        root, grid = Path(scratch), Path(scratch) / "grid.toml"
        grid.write_text(GRID.read_text().replace('"10-19"', '"10-29"'))
        cells = load_cells(grid)[:RUNS]
        assert len(cells) == RUNS, len(cells)
        for k, cell in enumerate(cells):
            make_up(cell, root / CELLS / cell.id, np.random.default_rng(k))
        assert not problems(root)
        started = time.perf_counter()
        subprocess.run([sys.executable, "-m", "experiments.report", str(root), "--out", str(root / "page.html")], check=True)
        print(f"report of {RUNS} runs: {time.perf_counter() - started:.1f} s (must be 20)")


def make_up(cell: Cell, where: Path, random: np.random.Generator) -> None:
    """The files of a finished run that a report reads."""
    (where / "run").mkdir(parents=True)
    write_json(where / CELL, {"id": cell.id, **cell.row, "command": "made up", "config": asdict(cell.config)})
    trained = cell.arm != ZERO_ACTION
    scores = dict.fromkeys(MEASURED, 1.0) | {"episodes": EPISODES * trained, "eval_return_mean": random.normal(100, 30)}
    scores["steps"] = EPISODES * 100 * trained
    write_json(where / "run" / RESULT, scores)
    if trained:
        write_json(where / "run" / RECORD, {"config": asdict(cell.config), "git": None, "versions": versions()})
        save_state(where / "run" / POLICY, {"weights": torch.zeros(16, 1024)})
        returns = np.cumsum(random.normal(1, 20, EPISODES))
        rows = [{"episode": k + 1, "steps": 100 * (k + 1), "return": r} for k, r in enumerate(returns)]
        points = [{"steps": 4000 * k, "episodes": 40 * k, "return_mean": 10.0 * k} for k in range(EVALUATIONS)]
        points[-1] = {column: scores[name] for name, column in STATED.items()}
        for name, lines in (("episodes", rows), ("evaluations", points)):
            write_csv(where / "run" / f"{name}.csv", [dict.fromkeys(TABLES[name], 0.123456789) | line for line in lines])


if __name__ == "__main__":
    main()
