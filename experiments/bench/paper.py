"""How fast are the `paper` presets beside the paper's code, and how soon do the default presets pass its best scores?

`python -m experiments.bench_paper`, with nothing beside it.
"""

from __future__ import annotations

import os

os.environ["OMP_NUM_THREADS"] = "1"  # before torch

import argparse
import statistics
import tempfile
import time
from pathlib import Path

import torch

from transferkit.config import TrainConfig, preset
from transferkit.config.names import Algorithm, Preset
from transferkit.transfer import Result, run_training

EPISODES = 200
IDP, HOPPER = "InvertedDoublePendulum-v5", "Hopper-v5"
PAPER = {"PPO": 5.0, "PPOPT": 5.5, "DYNA-DDPG": 161.0}
"""Seconds of the paper's code for 200 episodes of InvertedDoublePendulum-v5: one thread, plotting off, one seed."""

OURS: dict[str, tuple[dict, int]] = {
    "PPO": ({}, 5),
    "PPOPT": ({"core": "inverted-pendulum-v1"}, 5),
    "DYNA-DDPG": ({"algo": "dyna-ddpg"}, 2),
}
"""The same methods here, and how many seeds."""

BEST = {IDP: (186.0, 91.0), HOPPER: (77.0, 133.0)}
"""The paper's best method, DYNA-DDPG: mean training return of its last 50 of 200 episodes; and what doing nothing is worth."""

SHARE = 1 / 20
SEEDS = range(310, 320)


def main() -> None:
    """Measure and print."""
    argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter).parse_args()
    torch.set_num_threads(1)
    timed(TrainConfig(IDP, episodes=1), "default")  # imports
    for method in OURS:
        speed(method)
    hopper = timed(TrainConfig(HOPPER, algo="dyna-ddpg", episodes=EPISODES), "paper")[1]
    for env, whole in ((IDP, PAPER["DYNA-DDPG"]), (HOPPER, hopper)):
        for algo in ("ppo", "dyna-ddpg"):
            soon(env, algo, whole * SHARE)


def speed(method: str) -> None:
    """Seconds of a paper preset, beside the paper's code."""
    options, seeds = OURS[method]
    runs = [timed(TrainConfig(IDP, episodes=EPISODES, seed=seed, **options), "paper")[1] for seed in range(seeds)]
    middle = statistics.median(runs)
    print(
        f"{method}, paper preset, {IDP}: {middle:.1f} s ({min(runs):.1f} to {max(runs):.1f}, {seeds} seeds), "
        f"{PAPER[method] / middle:.2f} times as fast as the paper's code (must be 1.5)",
        flush=True,
    )


def soon(env: str, algo: Algorithm, seconds: float) -> None:
    """How many seeds of a default preset pass the paper's best score, and doing nothing, within these seconds."""
    runs = [timed(TrainConfig(env, algo=algo, seconds=seconds, seed=seed), "default")[0] for seed in SEEDS]
    returns = sorted(result.eval_return_mean for result in runs)
    print(
        f"{algo}, {env}: after {seconds:.1f} s {sum(value >= max(BEST[env]) for value in returns)} of {len(returns)} seeds "
        f"at {max(BEST[env]):g} or more (the paper {BEST[env][0]:g}, doing nothing {BEST[env][1]:g}): "
        + ", ".join(f"{value:.0f}" for value in returns),
        flush=True,
    )


def timed(config: TrainConfig, name: Preset) -> tuple[Result, float]:
    """A run with a preset, and its seconds, evaluation and files included."""
    with tempfile.TemporaryDirectory() as scratch:
        started = time.perf_counter()
        result = run_training(preset(config, name), out=Path(scratch) / "run")
        return result, time.perf_counter() - started


if __name__ == "__main__":
    main()
