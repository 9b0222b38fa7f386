"""What recording costs beside playing, how fast recordings are read, and how large they are."""

from __future__ import annotations

import statistics
import tempfile
import time
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING

import gymnasium
import torch

from experiments.bench.timing import spread
from transferkit.envs import derive_spec, make_env
from transferkit.evaluation import evaluate
from transferkit.record.play import record_episodes
from transferkit.record.reader import read_transitions
from transferkit.subject import load_subject
from transferkit.trainers.dyna.replay import Batch, ReplayBuffer

if TYPE_CHECKING:
    from transferkit.record.play import Subject
    from transferkit.spec import IOSpec

CORE = "inverted-pendulum-v1"


@dataclass(frozen=True)
class Size:
    """How much is measured."""

    rounds: int
    episodes: Mapping[str, int]
    """Episodes of a round, by environment."""


FULL = Size(15, {"InvertedPendulum-v5": 2, "Hopper-v5": 20, "dm_control/cartpole-balance-v0": 2})
TINY = Size(1, {"Hopper-v5": 1})


def main(size: Size) -> None:
    """Measure and print."""
    torch.set_num_threads(1)
    with tempfile.TemporaryDirectory() as scratch:
        for env, episodes in size.episodes.items():
            measure(load_subject(CORE, env=env), env, episodes, Path(scratch) / "bench.mcap", size.rounds)


def measure(subject: Subject, env: str, episodes: int, path: Path, rounds: int) -> None:
    """One environment; recording and evaluation take turns, both with one episode at a time."""
    costs, speeds, spec = [], [], derive_spec(env)
    for _ in range(rounds):
        path.unlink(missing_ok=True)
        plain = per_step(lambda: sum(play(subject, env, episodes)))
        costs.append(
            per_step(lambda: sum(episode.steps for episode in record_episodes(subject, path, episodes=episodes))) / plain
        )
        speeds.append(1 / per_step(lambda: fill(path, spec)))
    size = path.stat().st_size / fill(path, spec)
    print(
        f"{env}: recording takes {spread(costs)} times an evaluation (must be 1.15), read back at "
        f"{statistics.median(speeds):,.0f} steps a second (must be 20,000), {size:.0f} KB per 1,000 steps"
    )


def play(subject: Subject, env: str, episodes: int) -> list[int]:
    """Evaluate one episode after the other in one environment, as a recording plays them; their lengths."""
    made = make_env(env)
    assert isinstance(made, gymnasium.Wrapper)
    kept = Kept(made.env)
    return [evaluate(subject.policy, lambda: kept, episodes=1, seed=k).lengths[0] for k in range(episodes)]


class Kept(gymnasium.Wrapper):
    """An environment that is used again after an evaluation."""

    def close(self) -> None:
        """Keep it open."""


def fill(path: Path, spec: IOSpec) -> int:
    """Read a recording into a replay buffer; its steps."""
    buffer = ReplayBuffer(spec.obs_dim, spec.act_dim, 1_000_000)
    buffer.extend(Batch(*map(torch.from_numpy, read_transitions(path, spec).batch())))
    return len(buffer)


def per_step(play: Callable[[], int]) -> float:
    """Seconds a step of a call that returns its number of steps."""
    started = time.perf_counter()
    steps = play()
    return (time.perf_counter() - started) / steps
