"""`zoo verify`: is an artifact what it says it is?"""

from __future__ import annotations

from dataclasses import asdict
from pathlib import Path
from typing import Any

import numpy as np

from transferkit.config import TrainConfig
from transferkit.envs import id_from_file
from transferkit.errors import ArtifactError
from transferkit.evaluation import evaluate
from transferkit.zoo.artifact import check_probe, load_core
from transferkit.zoo.catalog import find_card, find_core

ROLLOUT_TOLERANCE = 0.02
"""Relative; another processor can end a near-chaotic episode differently."""


def verify(name: str | Path, *, rollout: bool = False, env: str | None = None) -> dict[str, Any]:
    """Check hashes, schema, shapes and probe outputs, and with `rollout` the score on the source task.

    A source whose id imports a module must be named as `env`.

    Returns the core's id, the largest probe difference and, if rolled out, the mean return.

    Raises:
        ArtifactError: anything does not hold.
    """
    folder = find_core(name)
    core, card = load_core(folder), find_card(folder)
    report: dict[str, Any] = {"id": core.id, "probe": check_probe(core, folder)}
    if rollout:
        source, rules = id_from_file(card.source.env_id, card.id, env, only=True), TrainConfig.from_json(card.config).env_config
        means = [
            evaluate(
                core.policy(member),
                source,
                episodes=card.score.episodes,
                seed=card.score.seed,
                **asdict(rules),
            ).mean
            for member in range(len(core.seeds))
        ]
        report["rollout_mean"], report["rollout_members"] = float(np.mean(means)), means
        low, high = card.score.low, card.score.high
        low, high = low - ROLLOUT_TOLERANCE * abs(low), high + ROLLOUT_TOLERANCE * abs(high)
        if not low <= report["rollout_mean"] <= high:
            raise ArtifactError(
                f"core {core.id} rolls out to {report['rollout_mean']:.1f}, its card says {card.score.mean:.1f} "
                f"({card.score.low:.1f} to {card.score.high:.1f})",
                remedy="compare versions",
                topic="installation",
            )
    return report
