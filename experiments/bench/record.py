"""`make bench`: what recording costs beside playing, how fast recordings are read, and how large they are."""

from __future__ import annotations

import os

os.environ["OMP_NUM_THREADS"] = "1"  # before torch

import statistics
import tempfile
import time
from collections.abc import Callable
from pathlib import Path

import gymnasium
import torch

from transferkit.deploy import load_subject
from transferkit.dyna.replay import Batch, ReplayBuffer
from transferkit.envs import derive_spec, make_env
from transferkit.evaluation import evaluate
from transferkit.record.play import Subject, record
from transferkit.record.reader import read_transitions
from transferkit.spec import IOSpec

CORE, ROUNDS = "inverted-pendulum-v1", 15
TARGETS = {"InvertedPendulum-v5": 2, "Hopper-v5": 20, "dm_control/cartpole-balance-v0": 2}
"""Episodes of a round."""


def main() -> None:
    """Measure and print."""
    torch.set_num_threads(1)
    with tempfile.TemporaryDirectory() as scratch:
        for env, episodes in TARGETS.items():
            measure(load_subject(CORE, env=env), env, episodes, Path(scratch) / "bench.mcap")


def measure(subject: Subject, env: str, episodes: int, path: Path) -> None:
    """One environment; recording and evaluation take turns, both with one episode at a time."""
    costs, speeds, spec = [], [], derive_spec(env)
    for _ in range(ROUNDS):
        path.unlink(missing_ok=True)
        plain = per_step(lambda: sum(play(subject, env, episodes)))
        costs.append(per_step(lambda: sum(episode.steps for episode in record(subject, path, episodes=episodes))) / plain)
        speeds.append(1 / per_step(lambda: fill(path, spec)))
    size = path.stat().st_size / fill(path, spec)
    print(
        f"{env}: recording takes {statistics.median(costs):.2f} times an evaluation ({min(costs):.2f} to {max(costs):.2f}; "
        f"must be 1.15), read back at {statistics.median(speeds):,.0f} steps a second (must be 20,000), "
        f"{size:.0f} KB per 1,000 steps"
    )


def play(subject: Subject, env: str, episodes: int) -> list[int]:
    """Evaluate one episode after the other in one environment, as a recording plays them; their lengths."""
    kept = Kept(make_env(env).env)
    return [evaluate(subject.policy, lambda: kept, episodes=1, seed=k).lengths[0] for k in range(episodes)]


class Kept(gymnasium.Wrapper):
    """An environment that is used again after an evaluation."""

    def close(self) -> None:
        """Nothing."""


def fill(path: Path, spec: IOSpec) -> int:
    """Read a recording into a replay buffer; its steps."""
    buffer = ReplayBuffer(spec.obs_dim, spec.act_dim, 1_000_000)
    buffer.extend(Batch(*map(torch.from_numpy, read_transitions(path, spec).batch())))
    return len(buffer)


def per_step(play: Callable[[], int]) -> float:
    """Seconds a step of what returns its number of steps."""
    started = time.perf_counter()
    steps = play()
    return (time.perf_counter() - started) / steps


if __name__ == "__main__":
    main()
