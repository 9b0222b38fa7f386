"""What does a core do on another environment before any target step? All members, beside the controls.

`python -m experiments.zero_shot --core inverted-pendulum-v1 --env dm_control/cartpole-balance-v0` adds its rows to the table.
"""

from __future__ import annotations

import argparse
import csv
from pathlib import Path

import torch

from transferkit.quickstart import zero_shot
from transferkit.table import format_table
from transferkit.versions import versions
from transferkit.zoo.artifact import load_core

RESULTS = Path(__file__).parent / "results" / "zero_shot.csv"
COLUMNS = ("core", "env", "policy", "return_mean", "low", "high", "members", "episodes", "seed", "mujoco", "torch")


def main() -> None:
    """Evaluate and write the rows."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--core", required=True)
    parser.add_argument("--env", required=True)
    parser.add_argument("--episodes", type=int, default=20)
    parser.add_argument("--seed", type=int, default=0)
    options = parser.parse_args()
    torch.set_num_threads(1)
    outcome = zero_shot(load_core(options.core), options.env, episodes=options.episodes, seed=options.seed)
    rows = [
        {
            "core": options.core,
            "env": options.env,
            "policy": row.who,
            "return_mean": round(row.mean, 2),
            "low": round(row.low, 2),
            "high": round(row.high, 2),
            "members": " ".join(f"{mean:.1f}" for mean in row.members),
            "episodes": options.episodes,
            "seed": options.seed,
            "mujoco": versions()["mujoco"],
            "torch": versions()["torch"],
        }
        for row in outcome
    ]
    known = list(csv.DictReader(RESULTS.open())) if RESULTS.exists() else []
    others = [row for row in known if (row["core"], row["env"]) != (options.core, options.env)]
    RESULTS.parent.mkdir(exist_ok=True)
    with RESULTS.open("w", newline="") as file:
        writer = csv.DictWriter(file, COLUMNS, lineterminator="\n")
        writer.writeheader()
        writer.writerows([*others, *rows])
    header = ("policy", "return_mean", "low", "high", "members")
    print(format_table(header, [[row[name] for name in header] for row in rows]))


if __name__ == "__main__":
    main()
