"""How long the report of many runs takes; their numbers are made up, their files as large as real ones."""

from __future__ import annotations

import subprocess
import sys
import tempfile
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np
import torch

from experiments.bench.timing import seconds
from experiments.matrix.cell_folder import CELL, CELLS, SCORES, SPEED
from experiments.matrix.grid_toml import load_cells
from experiments.matrix.results import read_results
from experiments.matrix.table import write_csv
from transferkit.files import write_json
from transferkit.run.directory import POLICY, RECORD, RESULT
from transferkit.run.state_file import save_state
from transferkit.run.tables import ALWAYS
from transferkit.versions import versions

if TYPE_CHECKING:
    from experiments.matrix.cell import Cell

GRID = """
episodes = 200
cores = ["inverted-pendulum-v1", "cartpole-balance-v1", "cartpole-swingup-v1", "pendulum-swingup-v1"]
targets = ["InvertedPendulum-v5", "InvertedDoublePendulum-v5", "Hopper-v5", "dm_control/cartpole-balance-v0",
  "dm_control/cartpole-swingup-v0", "dm_control/pendulum-swingup-v0"]
arms = ["transfer", "scratch", "random", "zero-action"]
seeds = "0-19"
"""
EPISODES, EVALUATIONS = 200, 5


@dataclass(frozen=True)
class Size:
    """How much is measured."""

    runs: int


FULL, TINY = Size(1000), Size(20)


def main(size: Size) -> None:
    """Measure and print."""
    with tempfile.TemporaryDirectory() as scratch:
        root, grid = Path(scratch), Path(scratch) / "grid.toml"
        grid.write_text(GRID)
        cells = load_cells(grid)[: size.runs]
        assert len(cells) == size.runs, len(cells)
        for k, cell in enumerate(cells):
            make_up(cell, root / CELLS / cell.id, np.random.default_rng(k))
        assert not read_results(root).damaged
        command = [sys.executable, "-m", "experiments.report", str(root), "--out", str(root / "page.html")]
        print(f"report of {size.runs} runs: {seconds(lambda: subprocess.run(command, check=True)):.1f} s (must be 20)")


def make_up(cell: Cell, where: Path, random: np.random.Generator) -> None:
    """The files of a finished run that a report reads."""
    run = where / "run"
    run.mkdir(parents=True)
    write_json(where / CELL, {**cell.to_json(), "command": "made up"})
    write_json(where / SPEED, {"forward_speed": None})
    result = {"episodes": EPISODES * cell.trained, "steps": EPISODES * 100 * cell.trained, "seconds": 1.0, "eval_episodes": 20}
    result |= {"eval_return_mean": random.normal(100, 30), "eval_return_std": 1.0}
    write_json(run / RESULT, result)
    write_json(run / RECORD, {"config": asdict(cell.config), "git": None, "versions": versions()})
    if cell.trained:
        save_state(run / POLICY, {"weights": torch.zeros(16, 1024)})
        returns = np.cumsum(random.normal(1, 20, EPISODES))
        lines = [{"episode": k + 1, "steps": 100 * (k + 1), "return": value} for k, value in enumerate(returns)]
        points = [{"steps": 4000 * k, "episodes": 40 * k, "return_mean": 10.0 * k} for k in range(EVALUATIONS)]
        points[-1] |= {column: result[name] for name, column in SCORES.items()}
        for kind, own in zip(ALWAYS, (lines, points), strict=True):
            write_csv(run / f"{kind.table}.csv", [dict.fromkeys(kind.columns(), 0.123456789) | line for line in own])
