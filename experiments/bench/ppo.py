"""`make bench`: speed against a peer, in alternation within one run; prints each ratio's median and range.

The machine's speed drifts, so only ratios of neighbours count.
"""

from __future__ import annotations

import os

os.environ["OMP_NUM_THREADS"] = "1"  # before torch

import statistics
import subprocess
import sys
import tempfile
import time
import warnings
from dataclasses import replace
from pathlib import Path

import torch

from transferkit.budget import Budget
from transferkit.config import PPOConfig
from transferkit.envs import VectorEnv, make_env
from transferkit.nn import Architecture
from transferkit.policy import ScratchPolicy
from transferkit.ppo import train
from transferkit.run import RunDirectory, Streams
from transferkit.run.session import Session

ENV, NUM_ENVS, ROLLOUT, EPOCHS, BATCH, HIDDEN = "Hopper-v5", 8, 2048, 10, 64, (128, 128)
ROLLOUTS, ROUNDS, STARTS = 2, 15, 7


def ours() -> float:
    """Environment steps per second of transferkit's PPO."""
    sizes = PPOConfig(num_envs=NUM_ENVS, rollout="steps", rollout_steps=ROLLOUT, epochs=EPOCHS, batch_size=BATCH, hidden=HIDDEN)
    config = replace(sizes, normalize_observation=False, normalize_reward=False, schedule="fixed")  # as the peer's PPO
    streams = Streams(0)
    envs = VectorEnv([make_env(ENV) for _ in range(NUM_ENVS)], lambda i, k: streams.integer("environment", i, k))
    dims = envs.envs[0].observation_space.shape[0], envs.envs[0].action_space.shape[0]
    policy = ScratchPolicy.create(Architecture(*dims, HIDDEN), streams.torch("policy"), init_std=1.0, normalize=False)
    with tempfile.TemporaryDirectory() as folder:
        directory = RunDirectory.create(Path(folder) / "run", {})
        session = Session(directory, Budget(steps=ROLLOUTS * ROLLOUT), NUM_ENVS, evaluate=dict, checkpoint_seconds=1e9)
        with session.running():
            started = time.perf_counter()
            train(policy, envs, config, session, streams, torch.device("cpu"))
            seconds = time.perf_counter() - started
        directory.close()
    return ROLLOUTS * ROLLOUT / seconds


def stable_baselines3() -> float:
    """Environment steps per second of stable-baselines3's PPO at the same settings."""
    from stable_baselines3 import PPO  # noqa: PLC0415
    from stable_baselines3.common.env_util import make_vec_env  # noqa: PLC0415

    kwargs = {"net_arch": {"pi": list(HIDDEN), "vf": list(HIDDEN)}}
    envs = make_vec_env(ENV, NUM_ENVS)
    model = PPO(
        "MlpPolicy",
        envs,
        n_steps=ROLLOUT // NUM_ENVS,
        batch_size=BATCH,
        n_epochs=EPOCHS,
        policy_kwargs=kwargs,
        device="cpu",
    )
    started = time.perf_counter()
    model.learn(ROLLOUTS * ROLLOUT)
    return ROLLOUTS * ROLLOUT / (time.perf_counter() - started)


def start_time(*arguments: str) -> float:
    """Seconds of a fresh Python process."""
    started = time.perf_counter()
    subprocess.run([sys.executable, *arguments], check=True, capture_output=True)
    return time.perf_counter() - started


def main() -> None:
    """Run and print."""
    warnings.simplefilter("ignore")
    torch.set_num_threads(1)
    ours(), stable_baselines3()  # warm up
    pairs = [(ours(), stable_baselines3()) for _ in range(ROUNDS)]
    ratios = sorted(a / b for a, b in pairs)
    print(f"PPO on {ENV}, {NUM_ENVS} envs, {ROLLOUT} steps a rollout, {EPOCHS} epochs of {BATCH}, {HIDDEN}, one thread")
    print("  env steps per second, transferkit | stable-baselines3: " + ", ".join(f"{a:.0f} | {b:.0f}" for a, b in pairs))
    print(f"  ratio: median {statistics.median(ratios):.2f}, {ratios[0]:.2f} to {ratios[-1]:.2f} (must be 1.3)")
    commands = {
        "python alone": ("-c", "pass"),
        "import transferkit (must be 0.15)": ("-c", "import transferkit"),
        "transferkit zoo list (must be 0.4)": ("-m", "transferkit", "zoo", "list"),
    }
    for name, arguments in commands.items():
        times = [start_time(*arguments) for _ in range(STARTS)]
        print(f"  {name}: median {statistics.median(times):.3f} s, {min(times):.3f} to {max(times):.3f}")


if __name__ == "__main__":
    main()
