"""Runs of stable-baselines3's PPO in a table that a matrix takes in, so that a study can compare with it.

It has its own defaults and `VecNormalize`, as its documentation recommends for PPO on MuJoCo. Environment, evaluation and seeds
of the evaluation are those of a matrix. What the table has already is not run again.
"""

from __future__ import annotations

import hashlib
import sys
import time
from concurrent.futures import as_completed
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np
import stable_baselines3
import torch
from numpy.typing import NDArray
from stable_baselines3.common.monitor import Monitor
from stable_baselines3.common.vec_env import DummyVecEnv, VecNormalize

from experiments.matrix.cell import Cell
from experiments.matrix.evaluation import forward_speed
from experiments.matrix.table import NAN, VERSIONS, read_rows, write_rows
from transferkit.cli.answer import Parser
from transferkit.cli.endings import ended
from transferkit.config import TrainConfig
from transferkit.envs import make_env
from transferkit.evaluation import DEFAULT_EPISODES, evaluate
from transferkit.versions import git_state, versions
from transferkit.workers import worker_pool

if TYPE_CHECKING:
    from collections.abc import Sequence

    from experiments.matrix.table import Row

TRAINER = "stable-baselines3"


class PeerPolicy:
    """Its deterministic policy behind its normaliser."""

    def __init__(self, model: stable_baselines3.PPO, normalizer: VecNormalize) -> None:
        self.model, self.normalizer = model, normalizer

    def act(self, observation: NDArray[np.float32]) -> NDArray[np.float32]:
        """Return actions `(B, act_dim)` for observations `(B, obs_dim)`."""
        normalized = self.normalizer.normalize_obs(observation)
        return self.model.predict(normalized, deterministic=True)[0].clip(-1.0, 1.0)  # pyright: ignore[reportArgumentType]


def main(arguments: Sequence[str] | None = None) -> int:
    """Train, evaluate and write a row for every seed; the exit status is 2 if an argument is wrong."""
    parser = Parser(prog="experiments.peer_runs", description=__doc__)
    parser.add_argument("--env", action="append", required=True, help="id; may be given several times")
    parser.add_argument("--steps", type=int, required=True)
    parser.add_argument("--seeds", type=int, nargs=2, metavar=("FIRST", "LAST"), required=True)
    parser.add_argument("--out", type=Path, required=True, help="table, such as runs/NAME/known/peer.csv")
    parser.add_argument("--workers", type=int, default=2)

    def command() -> int:
        options = parser.parse_args(arguments)
        first, last = options.seeds
        if last < first:
            parser.error(f"the last of --seeds {first} {last} is below the first")
        seeds = range(first, last + 1)
        configs = [TrainConfig(env, seed=seed, steps=options.steps) for seed in seeds for env in options.env]
        run_missing(configs, options.out, options.workers)
        return 0

    return ended(command, stopped="stopped; the same command goes on")


def run_missing(configs: Sequence[TrainConfig], out: Path, workers: int) -> None:
    """Run what the table does not have, and write it anew after each."""
    rows = {row.id: row for row in read_rows(out)} if out.exists() else {}
    to_do = [config for config in configs if row_id(config) not in rows]
    out.parent.mkdir(parents=True, exist_ok=True)
    with worker_pool(workers, len(to_do)) as pool:
        for done in as_completed([pool.submit(run, config) for config in to_do]):
            row = done.result()
            rows[row.id] = row
            write_rows(out, rows.values())
            print(f"{row.target}, seed {row.seed}: {row.eval_return_mean:.0f} in {row.seconds:.0f} s", flush=True)


def row_id(config: TrainConfig) -> str:
    """Name a run by what determines it."""
    return hashlib.sha256(f"{TRAINER} {config.env} {config.steps} {config.seed}".encode()).hexdigest()[:16]


def run(config: TrainConfig) -> Row:
    """Train with one seed and evaluate."""
    torch.set_num_threads(1)
    assert config.steps is not None
    envs = VecNormalize(DummyVecEnv([lambda: Monitor(make_env(config.env))]))
    model = stable_baselines3.PPO("MlpPolicy", envs, seed=config.seed, device="cpu")
    begin = time.perf_counter()
    model.learn(config.steps)
    seconds = time.perf_counter() - begin
    envs.training = False
    policy = PeerPolicy(model, envs)
    scores = evaluate(policy, config.env, episodes=DEFAULT_EPISODES).scores()
    speed = forward_speed(policy, config)
    found = versions()
    return replace(
        Cell("scratch", "", TRAINER, config).row,
        id=row_id(config),
        algo="",
        preset="",
        steps=model.num_timesteps,
        seconds=round(seconds, 1),
        eval_return_mean=scores["return_mean"],
        eval_return_std=scores["return_std"],
        forward_speed=NAN if speed is None else speed,
        commit=str((git_state() or {}).get("commit", "")),
        **{name: found[name] for name in VERSIONS},
    )


if __name__ == "__main__":
    sys.exit(main())
