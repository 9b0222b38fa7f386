"""The tables of a run directory: each row is a dataclass, and its fields are the table's columns."""

from __future__ import annotations

import csv
import hashlib
from dataclasses import MISSING, dataclass, fields
from pathlib import Path
from typing import ClassVar

import numpy as np
from numpy.typing import NDArray

from transferkit.files import damaged_run, read_json
from transferkit.reading import FormatError, read_bytes
from transferkit.run.result import RESULT, Checksums

LARGEST = 64 * 2**20
"""Bytes of a table."""


@dataclass(frozen=True)
class Row:
    """A row of a run's table."""

    table: ClassVar[str]
    """Name of the table, and of its file without `.csv`."""
    gaps: ClassVar[bool] = False
    """Whether a number may be missing, as NaN."""

    @classmethod
    def columns(cls) -> tuple[str, ...]:
        """The header; `return_` stands for `return`, which Python does not allow."""
        return tuple(field.name.rstrip("_") for field in fields(cls))

    @classmethod
    def later(cls) -> dict[str, float]:
        """The columns that earlier versions did not write, which come last, and what they would have held."""
        return {field.name: field.default for field in fields(cls) if field.default is not MISSING}

    @classmethod
    def file(cls, run: Path) -> Path:
        """Where it lies."""
        return run / f"{cls.table}.csv"

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
    core: int = 0
    """1 if the wrapped core was evaluated as it was before training, in place of what was learnt."""


@dataclass(frozen=True)
class ModelRow(Row):
    """A diagnosis of the learnt model (docs: dyna)."""

    table = "model"
    gaps = True
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


def read_table(run: Path, kind: type[Row]) -> dict[str, NDArray[np.float64]]:
    """Read a run's table by column, `(rows,)` each, up to a last row that is not whole yet.

    Raises:
        RunDirectoryError: there is no table, or it is damaged.
    """
    path = kind.file(run)
    with damaged_run(path):
        data = read_bytes(path, LARGEST)
        _check_digest(run, path, data)
        try:
            header, *rows = csv.reader(data[: data.rfind(b"\n") + 1].decode("ascii").splitlines())
            values = np.array(rows, float).reshape(-1, len(header))
        except (ValueError, csv.Error):
            raise FormatError("it is not a table of numbers") from None
        later = kind.later() if len(header) < len(kind.columns()) else {}
        if (*header, *later) != kind.columns() or not (np.isfinite(values) | (kind.gaps & np.isnan(values))).all():
            raise FormatError(f"it is not a table of {', '.join(kind.columns())}, all finite")
    return dict(zip(header, values.T, strict=True)) | {name: np.full(len(values), value) for name, value in later.items()}


def _check_digest(run: Path, path: Path, data: bytes) -> None:
    if (run / RESULT).exists():
        recorded = read_json(run / RESULT, Checksums).files
        if path.name in recorded and recorded[path.name] != hashlib.sha256(data).hexdigest():
            raise FormatError("it was changed: its checksum does not fit")
