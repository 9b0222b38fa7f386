"""Write `edited.csv`: the mean of the last 50 returns as in the paper's released data of Hopper, which has -10 for 0 or less.

`python -m experiments.studies.paper.edited runs/paper` takes the run folders of a matrix.
"""

from __future__ import annotations

import sys
from pathlib import Path

import numpy as np

from experiments.matrix.cell_folder import CELLS
from experiments.matrix.run_table import columns
from experiments.matrix.table import read_rows, write_csv
from transferkit.run import EpisodeRow

FOLDER = Path(__file__).parent
LAST, EDITED = 50, -10.0


def main(results: Path) -> None:
    """Write the values of PPO's runs on Hopper that are among the study's rows."""
    rows = [row for row in read_rows(FOLDER / "rows.csv") if row.target == "Hopper-v5" and row.algo == "ppo"]
    values = {row.id: edited(results / CELLS / row.id / "run") for row in rows}
    write_csv(FOLDER / "edited.csv", [{"id": name, "last_50_edited": value} for name, value in values.items()])


def edited(run: Path) -> float:
    """The edited mean of one run."""
    returns = columns(run, EpisodeRow)["return"][-LAST:]
    return round(float(np.mean(np.where(returns <= 0, EDITED, returns))), 3)


if __name__ == "__main__":
    main(Path(sys.argv[1]))
