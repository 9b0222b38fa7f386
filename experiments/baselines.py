"""Is the baseline strong? Scratch PPO with the default preset, over seeds; writes one CSV row per seed.

`python -m experiments.baselines --env InvertedPendulum-v5 --steps 100000 --seeds 0 1 2` resumes where it stopped.
"""

from __future__ import annotations

import argparse
import csv
from dataclasses import asdict
from pathlib import Path

from transferkit.config import TrainConfig
from transferkit.transfer import run_training
from transferkit.versions import versions

RESULTS = Path(__file__).parent / "results" / "baselines.csv"
COLUMNS = (
    "env",
    "seed",
    "episodes",
    "steps",
    "seconds",
    "eval_return_mean",
    "eval_return_std",
    "eval_episodes",
    "mujoco",
    "torch",
)


def main() -> None:
    """Train the seeds that the table lacks, and add them."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--env", required=True)
    parser.add_argument("--steps", type=int, required=True)
    parser.add_argument("--seeds", type=int, nargs="+", required=True)
    options = parser.parse_args()
    for seed in options.seeds:
        config = TrainConfig(options.env, seed=seed, steps=options.steps)
        out = Path("runs/baselines") / f"{options.env}_{options.steps}_seed{seed}"
        row = asdict(run_training(config, out=out, resume=True)) | {name: versions()[name] for name in ("mujoco", "torch")}
        add(row)
        print(f"{options.env} seed {seed}: {row['eval_return_mean']:.1f}", flush=True)


def add(row: dict) -> None:
    """Append a row unless the table has this run."""
    RESULTS.parent.mkdir(exist_ok=True)
    rows = list(csv.DictReader(RESULTS.open())) if RESULTS.exists() else []
    known = {(r["env"], r["seed"], r["steps"]) for r in rows}
    if (row["env"], str(row["seed"]), str(row["steps"])) in known:
        return
    with RESULTS.open("a", newline="") as file:
        writer = csv.DictWriter(file, COLUMNS, extrasaction="ignore", lineterminator="\n")
        if not rows:
            writer.writeheader()
        writer.writerow(row)


if __name__ == "__main__":
    main()
