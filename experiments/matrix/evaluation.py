"""What a matrix evaluates itself: policies that are not trained, and how fast a final policy moves forward."""

from __future__ import annotations

from dataclasses import asdict
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from experiments.matrix.arms import UNTRAINED, ZERO_ACTION
from experiments.matrix.cell_folder import SPEED
from transferkit.envs import dims_of, make_env, rollout
from transferkit.evaluation import POOL, RandomPolicy, ZeroPolicy, evaluate
from transferkit.files import write_json
from transferkit.run.directory import RECORD, RESULT
from transferkit.streams import Streams
from transferkit.versions import git_state, versions

if TYPE_CHECKING:
    from experiments.matrix.cell import Cell
    from transferkit.config import TrainConfig
    from transferkit.envs import Actor

REPORTED = "x_velocity"
"""Key under which Gymnasium's environments report their forward speed in m/s."""


def actor_without_policy(cell: Cell) -> Actor:
    """What acts in an arm that has no policy."""
    assert cell.arm in UNTRAINED
    act_dim = dims_of(cell.config.env)[1]
    return ZeroPolicy(act_dim) if cell.arm == ZERO_ACTION else RandomPolicy(act_dim, cell.config.seed)


def evaluate_untrained(actor: Actor, config: TrainConfig, run: Path) -> None:
    """Write record and result of a run without training."""
    run.mkdir(exist_ok=True)
    write_json(run / RECORD, {"config": asdict(config), "versions": versions(), "git": git_state()})
    scores = evaluate(actor, config.env, episodes=config.eval_episodes, **asdict(config.env_config)).scores()
    score = {f"eval_{name}": scores[name] for name in ("return_mean", "return_std")}
    write_json(run / RESULT, {"episodes": 0, "steps": 0, "seconds": 0.0, **score, "eval_episodes": config.eval_episodes})


def write_speed(actor: Actor, config: TrainConfig, where: Path) -> None:
    """Write the speed of a final policy, which makes its cell finished."""
    write_json(where / SPEED, {"forward_speed": forward_speed(actor, config)})


def forward_speed(actor: Actor, config: TrainConfig) -> float | None:
    """Mean forward speed in m/s over the episodes of an evaluation; None if the environment does not report it."""
    streams, episodes = Streams(0), config.eval_episodes
    envs = [make_env(config.env, **asdict(config.env_config)) for _ in range(min(POOL, episodes))]
    speeds = []
    for step in rollout(actor, envs, streams.episode, episodes=episodes):
        if REPORTED not in step.info:
            break
        speeds.append(step.info[REPORTED])
    for env in envs:
        env.close()
    return round(float(np.mean(speeds)), 3) if speeds else None
