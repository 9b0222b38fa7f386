"""PPO against stable-baselines3's at the same settings, and how long the package takes to start."""

from __future__ import annotations

import statistics
import subprocess
import sys
import tempfile
from dataclasses import dataclass
from functools import partial
from pathlib import Path

import torch
from stable_baselines3 import PPO
from stable_baselines3.common.env_util import make_vec_env

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


FULL, TINY = Size(rounds=15, rollouts=2, starts=7), Size(rounds=1, rollouts=1, starts=1)


def main(size: Size) -> None:
    """Measure in alternation and print."""
    torch.set_num_threads(1)
    steps = size.rollouts * ROLLOUT
    if size is FULL:
        ours(steps)  # to warm up
        stable_baselines3(steps)
    pairs = [(ours(steps), stable_baselines3(steps)) for _ in range(size.rounds)]
    print(f"PPO on {ENV}, {NUM_ENVS} envs, {ROLLOUT} steps a rollout, {EPOCHS} epochs of {BATCH}, {HIDDEN}, one thread")
    print("  env steps per second, transferkit | stable-baselines3: " + ", ".join(f"{a:.0f} | {b:.0f}" for a, b in pairs))
    print(f"  ratio: {spread(a / b for a, b in pairs)} (must be 1.3)")
    for name, arguments in COMMANDS.items():
        times = [seconds(partial(start, *arguments)) for _ in range(size.starts)]
        print(f"  {name}: {statistics.median(times):.3f} s, {min(times):.3f} to {max(times):.3f}")


def ours(steps: int) -> float:
    """Environment steps per second of transferkit's PPO."""
    config = TrainConfig(ENV, steps=steps, eval_episodes=1, checkpoint_seconds=1e9)
    with tempfile.TemporaryDirectory() as folder:
        return steps / run_training(with_settings(config, LIKE_THE_PEER), out=Path(folder) / "run").seconds


def stable_baselines3(steps: int) -> float:
    """Environment steps per second of stable-baselines3's PPO at the same settings."""
    layers = {"net_arch": {"pi": list(HIDDEN), "vf": list(HIDDEN)}}
    envs, share = make_vec_env(ENV, NUM_ENVS), ROLLOUT // NUM_ENVS
    model = PPO("MlpPolicy", envs, n_steps=share, batch_size=BATCH, n_epochs=EPOCHS, policy_kwargs=layers, device="cpu")
    return steps / seconds(lambda: model.learn(steps))


def start(*arguments: str) -> None:
    """Run a fresh Python process."""
    subprocess.run([sys.executable, *arguments], check=True, capture_output=True)
