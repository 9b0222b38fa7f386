"""The tables of a run directory: each row is a dataclass, and its fields are the table's columns."""

from __future__ import annotations

import csv
from dataclasses import dataclass, fields
from pathlib import Path
from typing import ClassVar


@dataclass(frozen=True)
class Row:
    """A row of a run's table."""

    table: ClassVar[str]
    """Name of the table, and of its file without `.csv`."""

    @classmethod
    def columns(cls) -> tuple[str, ...]:
        """The header; `return_` stands for `return`, which Python does not allow."""
        return tuple(field.name.rstrip("_") for field in fields(cls))

    def values(self) -> list[float]:
        """The cells, in the order of the columns."""
        return [getattr(self, field.name) for field in fields(self)]


@dataclass(frozen=True)
class EpisodeRow(Row):
    """A finished training episode."""

    table = "episodes"
    episode: int
    env_index: int
    return_: float
    length: int
    terminated: int
    steps: int
    """Environment steps of the run, up to its end."""
    seconds: float


@dataclass(frozen=True)
class EvaluationRow(Row):
    """An evaluation, after so many episodes, environment steps and seconds of training."""

    table = "evaluations"
    episodes: int
    steps: int
    seconds: float
    return_mean: float
    return_std: float
    return_low: float
    return_high: float
    n: float


@dataclass(frozen=True)
class ModelRow(Row):
    """A diagnosis of the learnt model (docs: dyna)."""

    table = "model"
    steps: int
    error_1: float
    error_5: float
    error_20: float
    disagreement: float
    reward_error: float
    termination_accuracy: float
    terminations_found: float


TABLES: tuple[type[Row], ...] = (EpisodeRow, EvaluationRow, ModelRow)
ALWAYS: tuple[type[Row], ...] = (EpisodeRow, EvaluationRow)
"""Tables that are there from the start; another comes with its first row."""


def read_table(run: Path, kind: type[Row]) -> list[dict[str, float]]:
    """Read the rows of a run's table, all values as numbers."""
    with (run / f"{kind.table}.csv").open(newline="") as file:
        return [{key: float(value) for key, value in row.items()} for row in csv.DictReader(file)]
