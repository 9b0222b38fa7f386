"""One run of a matrix: what it is, its id, and what its row says before it has run."""

from __future__ import annotations

import functools
import hashlib
import json
from dataclasses import asdict, dataclass, replace
from typing import cast

from experiments.matrix.arms import UNTRAINED
from experiments.matrix.table import Row
from transferkit.config import Algorithm, TrainConfig, identity, overrides, with_settings

ANY_CORE = "any"
"""Stands for a core if there is none, so that the trainer's wrapping counts in every arm."""


@dataclass(frozen=True)
class Cell:
    """One run."""

    arm: str
    core: str
    """Empty for arms that have none."""
    trainer: str
    """Empty for arms that are not trained."""
    config: TrainConfig

    @property
    def trained(self) -> bool:
        """Whether it has a budget; else its policy is evaluated as it begins."""
        return any(limit is not None for limit in (self.config.episodes, self.config.steps, self.config.seconds))

    @functools.cached_property
    def id(self) -> str:
        """Hash of everything that determines the run."""
        facts = identity(self._with_core)
        if self.arm in UNTRAINED:
            facts = {name: value for name, value in facts.items() if name not in ("algo", "preset", "overrides")}
        if not self.core:
            del facts["core"], facts["member"]
        text = json.dumps({"arm": self.arm, "core": self.core, "identity": facts}, sort_keys=True)
        return hashlib.sha256(text.encode()).hexdigest()[:16]

    @functools.cached_property
    def row(self) -> Row:
        """What its row says before it has run."""
        config, trains = self.config, self.arm not in UNTRAINED
        return Row(
            id=self.id,
            core=self.core,
            member=config.member,
            target=config.env,
            arm=self.arm,
            trainer=self.trainer,
            algo=config.algo if trains else "",
            preset=config.preset if trains else "",
            overrides=json.dumps(overrides(self._with_core), sort_keys=True) if trains else "{}",
            seed=config.seed,
            budget_episodes=config.episodes,
            budget_steps=config.steps,
            budget_seconds=config.seconds,
            eval_every=config.eval_every,
            eval_episodes=config.eval_episodes,
            device="" if config.device == "cpu" else config.device,
        )

    @classmethod
    def from_row(cls, row: Row) -> Cell:
        """The cell that a row is the result of.

        Raises:
            TransferkitError: its preset or one of its overrides is not known.
        """
        config = TrainConfig(
            row.target,
            algo=cast(Algorithm, row.algo or "ppo"),
            core=row.core or None,
            member=row.member,
            preset=row.preset or "default",
            seed=row.seed,
            episodes=row.budget_episodes,
            steps=row.budget_steps,
            seconds=row.budget_seconds,
            eval_every=row.eval_every,
            eval_episodes=row.eval_episodes,
            device=row.device or "cpu",
        )
        return cls(row.arm, row.core, row.trainer, with_settings(config, json.loads(row.overrides)))

    def to_json(self) -> dict[str, object]:
        """What its folder says of it."""
        return {"id": self.id, "arm": self.arm, "core": self.core, "trainer": self.trainer, "config": asdict(self.config)}

    @property
    def _with_core(self) -> TrainConfig:
        return replace(self.config, core=self.core or ANY_CORE)
