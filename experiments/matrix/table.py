"""One row for every run that ended, and its form as CSV."""

from __future__ import annotations

import csv
import io
import math
from collections import defaultdict
from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import Field, dataclass, fields
from pathlib import Path
from typing import Any

from transferkit.errors import RunDirectoryError
from transferkit.files import write_atomically
from transferkit.reading import parse, read_bytes

NAN = math.nan

LARGEST = 64 * 2**20
"""Bytes of a table."""


@dataclass(frozen=True)
class Row:
    """A run: what it was, what it spent, and what it came to. These fields are the columns of every table of runs."""

    id: str
    core: str
    """Empty for arms that have none."""
    member: int
    target: str
    arm: str
    trainer: str
    """Its name in the grid; empty for arms that are not trained."""
    algo: str
    preset: str
    """With its version, as `default-v2`."""
    overrides: str
    """Settings that differ from the preset, by dotted name, as a JSON object."""
    seed: int
    budget_episodes: int | None
    budget_steps: int | None
    budget_seconds: float | None
    eval_every: int
    eval_episodes: int
    episodes: int | None = None
    steps: int | None = None
    seconds: float = NAN
    eval_return_mean: float = NAN
    eval_return_std: float = NAN
    last_50_mean: float = NAN
    """Mean return of the last 50 training episodes, the paper's measure."""
    all_mean: float = NAN
    """Mean return of all training episodes."""
    forward_speed: float = NAN
    """Mean forward speed of the final policy in m/s, if the environment reports it."""
    commit: str = ""
    transferkit: str = ""
    mujoco: str = ""
    gymnasium: str = ""
    torch: str = ""
    error_kind: str = ""
    """Class of the error that ended the run; empty for a run that finished."""
    error: str = ""
    area: float = NAN
    """Mean return of its policy over all of its steps, by the evaluations during training; that of zero action on probation."""
    first_return_mean: float = NAN
    """The evaluation before any training, if there were others."""
    core_share: float = NAN
    """Share of its evaluations that the wrapped core played as it was before training."""
    refused: int | None = None
    """1 if probation refused its core, 0 if not."""
    device: str = ""
    """Torch device of its networks; empty for the CPU."""

    @property
    def budget(self) -> tuple[float | None, ...]:
        """Episodes, steps and seconds that it may spend."""
        return self.budget_episodes, self.budget_steps, self.budget_seconds

    @property
    def settings(self) -> tuple[object, ...]:
        """What its trainer's name stands for, beside the budget."""
        return self.algo, self.preset, self.overrides, self.eval_every, self.eval_episodes, self.device

    @property
    def finished(self) -> bool:
        """Whether it has a result."""
        return not self.error_kind


COLUMNS = tuple(field.name for field in fields(Row))
EARLIER = COLUMNS[: COLUMNS.index("area")], COLUMNS[: COLUMNS.index("device")]
"""Columns of the tables of earlier versions."""
VERSIONS = ("transferkit", "mujoco", "gymnasium", "torch")
CURVE_COLUMNS = ("id", "steps", "episodes", "seconds", "return_mean", "core")
"""Columns of a table of evaluations during training; `id` is that of the row."""


def read_rows(path: Path) -> list[Row]:
    """The rows of a table that `write_rows` wrote.

    Raises:
        RunDirectoryError: it has other columns, or a line is not a run that ended.
    """
    try:
        reader = csv.reader(io.StringIO(read_bytes(path, LARGEST).decode(), newline=""))
        columns = tuple(next(reader, ()))
        if columns not in (COLUMNS, *EARLIER):
            raise RunDirectoryError(f"{path} does not have the columns of this version's tables; remove it")
        known = fields(Row)[: len(columns)]
        return [_parse(known, cells, path, reader.line_num) for cells in reader]
    except (OSError, ValueError, csv.Error) as error:
        raise RunDirectoryError(f"{path} is not a table of runs ({error}); remove it") from None


def write_rows(path: Path, rows: Iterable[Row]) -> None:
    """Write rows as CSV, atomically."""
    write_csv(path, [{name: getattr(row, name) for name in COLUMNS} for row in rows])


def write_csv(path: Path, rows: Sequence[Mapping[str, object]]) -> None:
    """Write rows that have the same keys as CSV, atomically; None and NaN become empty cells."""
    text = io.StringIO()
    writer = csv.writer(text, lineterminator="\n")
    writer.writerow(rows[0])
    writer.writerows([_cell(value) for value in row.values()] for row in rows)
    write_atomically(path, text.getvalue().encode())


def ambiguity(rows: Iterable[Row]) -> str:
    """What one trainer's name stands for twice on one target, so that no table can tell it apart; empty if nothing does."""
    meanings: dict[tuple[str, str, str], set[object]] = defaultdict(set)
    for row in rows:
        for what, value in (("budgets", row.budget), ("settings", row.settings)):
            meanings[row.trainer or row.arm, row.target, what].add(value)
    twice = [(*names, len(found)) for names, found in meanings.items() if len(found) > 1]
    return "".join(f"runs of {trainer} on {target} with {count} {what}" for trainer, target, what, count in twice[:1])


def _parse(columns: Sequence[Field[Any]], cells: Sequence[str], path: Path, line: int) -> Row:
    try:
        row = Row(**{column.name: PARSERS[str(column.type)](text) for column, text in zip(columns, cells, strict=True)})
        if not (row.id and row.target and row.arm and isinstance(parse(row.overrides, object), dict)):
            raise ValueError(row)
        if row.finished and math.isnan(row.eval_return_mean):
            raise ValueError(row)
    except ValueError:
        raise RunDirectoryError(f"{path}, line {line}, is not a run that ended; remove it") from None
    return row


def _number(text: str) -> float:
    value = float(text) if text else NAN
    if text and not math.isfinite(value):
        raise ValueError(text)
    return value


def _whole(text: str) -> int:
    number = int(text) if len(text) < 20 and text.isascii() and text.isdecimal() else -1
    if not 0 <= number < 2**63:
        raise ValueError(text)
    return number


PARSERS: Mapping[str, Callable[[str], Any]] = {
    "str": str,
    "int": _whole,
    "float": _number,
    "int | None": lambda text: _whole(text) if text else None,
    "float | None": lambda text: _number(text) if text else None,
}
"""From the text of a cell, by the annotation of its field."""


def _cell(value: object) -> object:
    return "" if value is None or (isinstance(value, float) and math.isnan(value)) else value
