"""What a distillation is given."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import Annotated

from transferkit.config.checks import (
    AT_LEAST_ONE,
    BATCH,
    MEMBERS,
    NOT_NEGATIVE,
    RATE,
    Different,
    Hidden,
    Items,
    Seed,
    check,
)
from transferkit.errors import SettingError
from transferkit.nn.policy_net import Activation
from transferkit.zoo.release import core_id

ENVS = 5
"""Environments that are played side by side."""


@dataclass(frozen=True)
class DistillConfig:
    """A student to train, as a core with one member for each of its teacher."""

    name: str
    """Name of the core without its version."""
    version: Annotated[int, AT_LEAST_ONE] = 1
    zoo: str | Path = "zoo"
    """Folder the artifact goes into."""
    members: Annotated[tuple[Annotated[int, NOT_NEGATIVE], ...], Items(int(MEMBERS.high)), Different()] | None = None
    """Which of the teacher's members; by default all."""
    best: bool = False
    """Of a run: its best policy is the teacher, and not its final one."""
    steps: Annotated[int, AT_LEAST_ONE] = 100_000
    """Environment steps of a member."""
    rounds: Annotated[int, AT_LEAST_ONE] = 20
    """Times that the student learns from all that was seen, and then acts itself."""
    passes: Annotated[int, AT_LEAST_ONE] = 4
    """Passes over all that was seen in each round; the last has five times as many."""
    batch: Annotated[int, BATCH] = 256
    lr: Annotated[float, RATE] = 1e-3
    """Adam's, in the last round falling to zero."""
    hidden: Hidden = (256, 256)
    activation: Activation = "elu"
    seed: Seed = 0
    """Of initial weights, of batches and of the episodes' starts."""
    threshold: float | None = None
    """Mean return that every member has to reach."""

    def __post_init__(self) -> None:
        check(self)
        core_id(self.name, self.version)
        if self.steps < ENVS * self.rounds:
            raise SettingError("steps", value=self.steps, allowed=f"at least {ENVS} in each of {self.rounds} rounds")

    @property
    def folder(self) -> Path:
        """The folder of the artifact."""
        return Path(self.zoo) / core_id(self.name, self.version)

    @property
    def steps_of_a_round(self) -> int:
        """Steps of each environment in a round."""
        return self.steps // self.rounds // ENVS
