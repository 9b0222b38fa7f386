"""PPO against other libraries' at the same settings, and how long the package takes to start."""

from __future__ import annotations

import statistics
import subprocess
import sys
import tempfile
from dataclasses import dataclass
from functools import partial
from pathlib import Path

import stable_baselines3
import torch

from experiments.bench import peers
from experiments.bench.timing import seconds, spread
from transferkit.config import TrainConfig, with_settings
from transferkit.training import run_training

ENV, NUM_ENVS, ROLLOUT, EPOCHS, BATCH, HIDDEN = "Hopper-v5", 8, 2048, 10, 64, (128, 128)
LIKE_THE_PEER = {
    "ppo.num_envs": NUM_ENVS,
    "ppo.rollout": "steps",
    "ppo.rollout_steps": ROLLOUT,
    "ppo.epochs": EPOCHS,
    "ppo.batch_size": BATCH,
    "ppo.schedule": "fixed",
    "ppo.normalize_reward": False,
    "network.hidden": HIDDEN,
    "network.init_std": 1.0,
    "network.normalize_observation": False,
}
COMMANDS = {
    "python alone": ("-c", "pass"),
    "import transferkit (must be 0.15)": ("-c", "import transferkit"),
    "transferkit zoo list (must be 0.4)": ("-m", "transferkit", "zoo", "list"),
}


@dataclass(frozen=True)
class Size:
    """How much is measured."""

    rounds: int
    rollouts: int
    starts: int
    compiles: bool


FULL, TINY = Size(rounds=15, rollouts=2, starts=7, compiles=True), Size(rounds=1, rollouts=1, starts=1, compiles=False)


def main(size: Size) -> None:
    """Measure in alternation and print."""
    torch.set_num_threads(1)
    steps = size.rollouts * ROLLOUT
    like = (ENV, NUM_ENVS, ROLLOUT, EPOCHS, BATCH, HIDDEN[0], steps)
    calls = {
        "transferkit, compiled": partial(ours, steps, compiles=size.compiles),
        "transferkit, eager": partial(ours, steps, compiles=False),
        "stable-baselines3 (must be 1.5)": partial(steps_per_second, peers.ppo_steps(stable_baselines3, *like), steps),
        "rsl_rl's own (must be 1.3)": partial(steps_per_second, peers.rsl_rl_steps(*like), steps),
    }
    if sbx := peers.optional("sbx"):
        calls["SBX (must be 1.05)"] = partial(steps_per_second, peers.ppo_steps(sbx, *like), steps)
    if size is FULL:
        for call in calls.values():  # to warm up
            call()
    rounds = [{name: call() for name, call in calls.items()} for _ in range(size.rounds)]
    print(f"PPO on {ENV}, {NUM_ENVS} envs, {ROLLOUT} steps a rollout, {EPOCHS} epochs of {BATCH}, {HIDDEN}, one thread")
    first = next(iter(calls))
    for name in calls:
        ratios = spread(one[first] / one[name] for one in rounds)
        speed = statistics.median(one[name] for one in rounds)
        print(f"  {name}: {speed:.0f} env steps per second; the first is {ratios} times as fast")
    for name, arguments in COMMANDS.items():
        times = [seconds(partial(start, *arguments)) for _ in range(size.starts)]
        print(f"  {name}: {statistics.median(times):.3f} s, {min(times):.3f} to {max(times):.3f}")


def ours(steps: int, *, compiles: bool) -> float:
    """Environment steps per second of transferkit's PPO."""
    config = TrainConfig(ENV, steps=steps, eval_episodes=1, checkpoint_seconds=1e9, compile="on" if compiles else "off")
    with tempfile.TemporaryDirectory() as folder:
        return steps / run_training(with_settings(config, LIKE_THE_PEER), out=Path(folder) / "run").seconds


def steps_per_second(call: peers.Call, steps: int) -> float:
    """Environment steps per second of a peer."""
    return steps / seconds(call)


def start(*arguments: str) -> None:
    """Run a fresh Python process."""
    subprocess.run([sys.executable, *arguments], check=True, capture_output=True)
