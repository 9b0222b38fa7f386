"""Run directories, finished and stopped, and cells of a matrix."""

from __future__ import annotations

import contextlib
import json
import signal
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING, Any

import torch

from experiments.bench.faults import mutate
from experiments.bench.faults.formats import (
    ENV,
    Format,
    damage,
    forge_json,
    forge_state,
    sha256,
)
from experiments.matrix.cell import Cell
from experiments.matrix.cell_folder import CELL, SPEED, DamagedError, cell_folders
from experiments.matrix.results import collect, read_results
from experiments.matrix.runner import run_cell
from transferkit.config import TrainConfig, identity, with_settings
from transferkit.errors import InterruptedRunError
from transferkit.files import read_json
from transferkit.policy.saved import load_policy
from transferkit.reading import sealed
from transferkit.run import CHECKPOINT, POLICY, RECORD, RESULT, EpisodeRow, EvaluationRow, Result, read_record, read_table
from transferkit.subject import load_value
from transferkit.training import run_training

if TYPE_CHECKING:
    from experiments.bench.faults.formats import Random
    from transferkit.config import Algorithm

SETTINGS: dict[Algorithm, dict[str, Any]] = {
    "ppo": {"ppo.epochs": 1, "ppo.rollout": "steps", "ppo.rollout_steps": 16, "network.hidden": [8]},
    "dyna-ddpg": {"network.hidden": [8], "model.hidden": [8], "model.members": 2, "dyna.updates_per_step": 1},
    "dyna-ppo": {
        "network.hidden": [8],
        "model.hidden": [8],
        "model.members": 2,
        "model.every": 50,
        "model.updates": 2,
        "dyna_ppo.rollouts": 4,
    },
}
"""The smallest runs."""

CHECKPOINTS = {"ppo": 0.02, "dyna-ddpg": 0.008, "dyna-ppo": 0.003}
"""Their shares: each trains to its end, which takes long."""


def runs(scratch: Path) -> list[Format]:
    """A finished and a stopped run of each trainer."""
    found = []
    for algo, settings in SETTINGS.items():
        config = TrainConfig(ENV, algo=algo, steps=200, eval_episodes=1, eval_every=100)
        config = with_settings(config, settings)
        run_training(config, out=scratch / algo)
        _stop(config, scratch / f"{algo}-stopped")
        stopped = scratch / f"{algo}-stopped"
        found += [
            Format(f"finished runs, {algo}", 0.1, scratch / algo, _change_run, _read_run, _same_run),
            Format(f"checkpoints, {algo}", CHECKPOINTS[algo], stopped, _change_checkpoint, _resume(config), _same_end),
        ]
    return found


def _stop(config: TrainConfig, out: Path) -> None:
    """Leave a run stopped half way, as by Ctrl-C."""
    with contextlib.suppress(InterruptedRunError):
        run_training(config, out=out, report=lambda *_: signal.raise_signal(signal.SIGINT))
    assert (out / CHECKPOINT).exists()


def _change_run(run: Path, random: Random) -> bool:
    name = str(random.choice([RECORD, RECORD, RESULT, POLICY, POLICY, "episodes.csv", "evaluations.csv"]))
    path = run / name
    if random.random() < 0.4:
        return damage(path, random)
    if path.suffix == ".json":
        return forge_json(path, random)
    if path.suffix == ".csv":
        path.write_text(mutate.in_tokens(path.read_text().replace(",", "=", 1), random).replace("=", ","), errors="replace")
        result = json.loads((run / RESULT).read_text())
        result["files"][name] = sha256(path.read_bytes())
        (run / RESULT).write_text(json.dumps(sealed(result)))
        return True
    return forge_state(path, random)


def _read_run(run: Path, random: Random) -> Any:  # noqa: ANN401 - what a run holds
    del random
    record = read_record(run)
    config = TrainConfig.from_json(record)
    policy = load_policy(run)
    load_value(run, policy)
    with torch.no_grad():
        policy(torch.zeros(2, policy.obs_dim))
    tables = [{name: column.tolist() for name, column in read_table(run, kind).items()} for kind in (EpisodeRow, EvaluationRow)]
    return identity(config), read_json(run / RESULT, Result), tables, policy.state_dict()


def _same_run(found: Any, whole: Any) -> bool:  # noqa: ANN401 - what runs hold
    same = all(torch.equal(found[3][name], tensor) for name, tensor in whole[3].items())
    return same and found[:3] == whole[:3]


def _change_checkpoint(run: Path, random: Random) -> bool:
    name = str(random.choice([CHECKPOINT, CHECKPOINT, CHECKPOINT, RECORD]))
    if random.random() < 0.25:
        return damage(run / name, random)
    return forge_state(run / name, random) if name == CHECKPOINT else forge_json(run / name, random)


def _resume(config: TrainConfig) -> Any:  # noqa: ANN401 - a reader
    return lambda run, random: run_training(replace(config), out=run, resume=True)


def _same_end(found: Result, whole: Result) -> bool:
    return replace(found, seconds=0.0, run_dir="") == replace(whole, seconds=0.0, run_dir="")


def cells(out: Path) -> Format:
    """A cell of a matrix that is done."""
    cell = Cell(
        "scratch", "", "small", with_settings(TrainConfig(ENV, steps=64, eval_episodes=1, eval_every=32), SETTINGS["ppo"])
    )
    run_cell(cell, out, "a test")
    return Format("cells", 0.08, out, _change_cell, _collect)


def _change_cell(out: Path, random: Random) -> bool:
    (where,) = cell_folders(out)
    if random.random() < 0.4:
        return _change_run(where / "run", random)
    path = where / str(random.choice([CELL, CELL, SPEED]))
    return (forge_json if random.random() < 0.6 else damage)(path, random)


def _collect(out: Path, random: Random) -> Any:  # noqa: ANN401 - rows
    del random
    results = read_results(out)
    for what in results.damaged.values():
        raise DamagedError(what)
    collect(out)
    return results.rows
