"""How fast the paper presets are beside the paper's code, and how soon the default presets pass its best scores."""

from __future__ import annotations

import statistics
import tempfile
import time
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING

import torch

from transferkit.config import TrainConfig
from transferkit.training import run_training

if TYPE_CHECKING:
    from transferkit.config import Algorithm
    from transferkit.run.result import Result

IDP, HOPPER = "InvertedDoublePendulum-v5", "Hopper-v5"
PAPER = {"PPO": 5.0, "PPOPT": 5.5, "DYNA-DDPG": 161.0}
"""Seconds of the paper's code for 200 episodes of InvertedDoublePendulum-v5: one thread, plotting off, one seed."""

BEST = {IDP: (186.0, 91.0), HOPPER: (77.0, 133.0)}
"""The paper's best method, DYNA-DDPG: mean training return of its last 50 of 200 episodes; and what doing nothing is worth."""

SHARE = 1 / 20


@dataclass(frozen=True)
class Size:
    """How much is measured."""

    episodes: int
    seeds: Mapping[str, int]
    """Seeds of each method."""
    fresh: range
    """Seeds of the default presets."""


FULL = Size(200, {"PPO": 5, "PPOPT": 5, "DYNA-DDPG": 2}, range(310, 320))
TINY = Size(1, {"PPO": 1, "PPOPT": 1, "DYNA-DDPG": 1}, range(310, 311))


def main(size: Size) -> None:
    """Measure and print."""
    torch.set_num_threads(1)
    timed(TrainConfig(IDP, episodes=1))  # imports
    for method in PAPER:
        speed(method, size)
    hopper = timed(TrainConfig(HOPPER, algo="dyna-ddpg", preset="paper-v1", episodes=size.episodes))[1]
    for env, whole in ((IDP, PAPER["DYNA-DDPG"] * size.episodes / FULL.episodes), (HOPPER, hopper)):
        for algo in ("ppo", "dyna-ddpg"):
            soon(env, algo, whole * SHARE, size.fresh)


def speed(method: str, size: Size) -> None:
    """Seconds of a paper preset, beside the paper's code."""
    algo: Algorithm = "dyna-ddpg" if method == "DYNA-DDPG" else "ppo"
    core, seeds = "inverted-pendulum-v1" if method == "PPOPT" else None, range(size.seeds[method])
    configs = [TrainConfig(IDP, core=core, algo=algo, preset="paper-v1", episodes=size.episodes, seed=seed) for seed in seeds]
    runs = [timed(config)[1] for config in configs]
    middle = statistics.median(runs)
    print(
        f"{method}, paper preset, {IDP}: {middle:.1f} s ({min(runs):.1f} to {max(runs):.1f}, {len(seeds)} seeds), "
        f"{PAPER[method] / middle:.2f} times as fast as the paper's code (must be 1.5)",
        flush=True,
    )


def soon(env: str, algo: Algorithm, seconds: float, seeds: range) -> None:
    """How many seeds of a default preset pass the paper's best score, and doing nothing, within these seconds."""
    runs = [timed(TrainConfig(env, algo=algo, seconds=seconds, seed=seed))[0] for seed in seeds]
    returns = sorted(result.eval_return_mean for result in runs)
    print(
        f"{algo}, {env}: after {seconds:.1f} s {sum(value >= max(BEST[env]) for value in returns)} of {len(returns)} seeds "
        f"at {max(BEST[env]):g} or more (the paper {BEST[env][0]:g}, doing nothing {BEST[env][1]:g}): "
        + ", ".join(f"{value:.0f}" for value in returns),
        flush=True,
    )


def timed(config: TrainConfig) -> tuple[Result, float]:
    """A run, and its seconds, evaluation and files included."""
    with tempfile.TemporaryDirectory() as scratch:
        started = time.perf_counter()
        result = run_training(config, out=Path(scratch) / "run")
        return result, time.perf_counter() - started
