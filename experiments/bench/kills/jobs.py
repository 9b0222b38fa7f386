"""Jobs that are killed, each as small as it can be."""

from __future__ import annotations

import json
import os
from collections.abc import Callable, Collection, Iterator, Mapping
from concurrent.futures import Future
from contextlib import contextmanager
from dataclasses import dataclass, replace
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Any
from unittest import mock

from experiments.matrix import runner
from experiments.matrix.grid_toml import load_cells
from transferkit.config import TrainConfig, with_settings
from transferkit.export import export_onnx
from transferkit.pretrain import Recipe, pretrain
from transferkit.record.play import record_episodes
from transferkit.record.reader import read
from transferkit.subject import load_subject
from transferkit.training import run_training

if TYPE_CHECKING:
    from experiments.matrix.cell import Cell
    from transferkit.config import Algorithm

CORE, ENV = "inverted-pendulum-v1", "InvertedPendulum-v5"
PPO = {"ppo.num_envs": 2, "ppo.rollout": "steps", "ppo.rollout_steps": 32, "ppo.epochs": 1}
MODEL = {"model.members": 2, "model.hidden": (8,), "model.every": 40, "model.updates": 2}
SETTINGS: Mapping[Algorithm, Mapping[str, Any]] = {
    "ppo": PPO,
    "dyna-ddpg": {**MODEL, "dyna.updates_per_step": 1, "dyna.batch_size": 8, "dyna.random_steps": 20, "dyna.model_share": 0.5},
    "dyna-ppo": {**PPO, **MODEL, "dyna_ppo.updates": 1, "dyna_ppo.rollouts": 4, "dyna_ppo.horizon": 2},
}
GRID = f"""
steps = 70
cores = ["{CORE}"]
targets = ["{ENV}"]
arms = ["transfer", "scratch", "zero-action"]
seeds = [0]
eval_every = 35
eval_episodes = 1
[[trainer]]
name = "small"
[trainer.set]
"wrap.probation" = 0
{chr(10).join(f'"{name}" = {json.dumps(value)}' for name, value in PPO.items())}
"""


@dataclass(frozen=True)
class Job:
    """A call that goes on where a killed one stopped, with everything below one folder."""

    name: str
    run: Callable[[Path], object]
    share: int
    """Of a hundred kills."""
    processes: bool = False
    """It works in processes of its own, whose file operations nobody counts: it is killed at random times only."""


def train(algo: Algorithm, folder: Path) -> None:
    """Train a few steps, with a checkpoint after every update."""
    config = TrainConfig(ENV, algo=algo, steps=130, eval_every=60, eval_episodes=1, checkpoint_seconds=0.0)
    run_training(with_settings(config, SETTINGS[algo]), out=folder / "run", resume=True)


def record(folder: Path) -> None:
    """Record two episodes; a recording that was cut stays, and the next has another name."""
    cut = sorted(folder.glob("played_*.mcap"))
    if not (cut and _whole(cut[-1])):
        record_episodes(load_subject(CORE), folder / f"played_{len(cut):02}.mcap", episodes=2)


def matrix(workers: int, folder: Path) -> None:
    """Run three cells; without workers in this process."""
    grid = folder.with_name("grid.toml")
    grid.write_text(GRID)
    alone: dict[str, Any] = {} if workers else {"worker_pool": no_pool, "plan": lambda *_: "", "import_beside": lambda *_: None}
    with mock.patch.multiple(runner, load_cells=_eager_cells, **alone):
        if runner.run(grid, folder / "out", workers=workers or 1):
            raise RuntimeError("a cell failed")


def make_core(workers: int, folder: Path) -> None:
    """Pretrain a core of two members, unless it is there."""
    recipe = Recipe("small", 0.0, seeds=(0, 1), workers=workers)
    config = TrainConfig(ENV, steps=70, eval_episodes=1, checkpoint_seconds=0.0)
    os.chdir(folder)  # the members' runs are below the working folder
    if not (recipe.zoo / recipe.id).exists():
        pretrain(recipe, with_settings(config, PPO))


def export(folder: Path) -> None:
    """Export a core as ONNX, unless it is there."""
    if not (folder / "policy.onnx").exists():
        export_onnx(load_subject(CORE, values=False), folder / "policy.onnx")


JOBS = (
    Job("ppo", partial(train, "ppo"), 20),
    Job("dyna-ddpg", partial(train, "dyna-ddpg"), 16),
    Job("dyna-ppo", partial(train, "dyna-ppo"), 16),
    Job("record", record, 16),
    Job("matrix", partial(matrix, 0), 14),
    Job("pretrain", partial(make_core, 1), 11),
    Job("export", export, 4),
    Job("matrix, 2 workers", partial(matrix, 2), 2, processes=True),
    Job("pretrain, 2 workers", partial(make_core, 2), 1, processes=True),
)


def _whole(path: Path) -> bool:
    return path.stat().st_size > 0 and not read(path).flaw


def _eager_cells(grid: Path, named: Collection[str] = ()) -> list[Cell]:
    """A grid's cells with a checkpoint after every update."""
    return [replace(cell, config=replace(cell.config, checkpoint_seconds=0.0)) for cell in load_cells(grid, named)]


class _Here:
    """A pool without processes."""

    def submit(self, job: Callable[[Any], Any], cell: object) -> Future[Any]:
        done: Future[Any] = Future()
        try:
            done.set_result(job(cell))
        except Exception as error:  # the one who waits gets it, as from a process
            done.set_exception(error)
        return done


@contextmanager
def no_pool(workers: int, jobs: int) -> Iterator[_Here]:
    """Stand in for a pool of processes."""
    del workers, jobs
    yield _Here()
