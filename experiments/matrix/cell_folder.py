"""A run of a matrix on disk: the folder `cells/<id>`, what is in it, and the row that it gives."""

from __future__ import annotations

import itertools
from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from dataclasses import dataclass, replace
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import msgspec
import numpy as np
from numpy.typing import NDArray

from experiments.matrix.cell import Cell
from experiments.matrix.run_table import columns
from experiments.matrix.table import NAN, VERSIONS
from transferkit import stats
from transferkit.config import TrainConfig
from transferkit.errors import RunDirectoryError, TransferkitError
from transferkit.files import read_json, write_atomically
from transferkit.reading import Count
from transferkit.run import CHECKPOINT, POLICY, RECORD, RESULT, EpisodeRow, EvaluationRow, Probation, Record, load_state

if TYPE_CHECKING:
    from experiments.matrix.table import Row

CELLS, SET_ASIDE = "cells", "damaged"
CELL, ERROR, SPEED = "cell.json", "error.json", "speed.json"
"""What a cell is; why its last try failed; the final policy's speed, which is written last."""

RUN_FILES = (RECORD, RESULT, POLICY, "episodes.csv", "evaluations.csv", "model.csv")
"""What a finished run is; the rest is its checkpoint and logs."""

SCORES = {"eval_return_mean": "return_mean", "eval_return_std": "return_std", "eval_episodes": "n", "steps": "steps"}
"""What a result repeats of its last evaluation."""

LAST = 50
"""Episodes at the end whose mean return is the paper's measure."""


@dataclass(frozen=True)
class CellFile:
    """What `cell.json` holds."""

    id: str
    arm: str
    core: str
    trainer: str
    config: dict[str, Any]
    command: str


@dataclass(frozen=True)
class Failure:
    """What `error.json` holds."""

    kind: Annotated[str, msgspec.Meta(min_length=1)]
    message: str


@dataclass(frozen=True)
class Speed:
    """What `speed.json` holds."""

    forward_speed: float | None


@dataclass(frozen=True)
class Scores:
    """What a row takes of a result."""

    episodes: Count
    steps: Count
    seconds: float
    eval_return_mean: float
    eval_return_std: float
    eval_episodes: Count
    probation: Probation | None = None


class DamagedError(TransferkitError):
    """A cell whose files are not what a matrix writes; `what` names the file."""


def folder(out: Path, cell: Cell) -> Path:
    """Where a cell lies: what it is, its run directory in `run`, and its error if it has failed."""
    return out / CELLS / cell.id


def read_cell(where: Path) -> Row | None:
    """The row of a cell that ended; None if it has not.

    Raises:
        DamagedError: a file is missing, cannot be read, or contradicts another.
        RunDirectoryError: it is a cell of an earlier version.
    """
    run = where / "run"
    cell = _cell(where)
    ended = (where / SPEED).exists() or (where / ERROR).exists()
    row = replace(cell.row, **(_made_by(run) if ended and (run / RECORD).exists() else {}))
    if (where / SPEED).exists():
        return _finished(cell, row, where)
    if (where / ERROR).exists():
        with _naming(ERROR):
            error = read_json(where / ERROR, Failure)
            return replace(row, error_kind=error.kind, error=error.message)
    if (run / CHECKPOINT).exists():
        with _naming(CHECKPOINT):
            load_state(run / CHECKPOINT)
    return None


def cell_folders(out: Path) -> list[Path]:
    """Every cell that was ever started, in the order of its name; a start killed before it wrote anything does not count."""
    return sorted({path.parent for name in (CELL, "run") for path in (out / CELLS).glob(f"*/{name}")})


def set_aside(out: Path, where: Path) -> Path:
    """Move a damaged cell out of the way, so that it runs again; returns where it is now."""
    names = (out / SET_ASIDE / f"{where.name}.{k}" for k in itertools.count())
    copy = next(name for name in names if not name.exists())
    copy.parent.mkdir(exist_ok=True)
    return where.rename(copy)


def pack(where: Path) -> dict[str, bytes]:
    """The files of a cell by their path, without checkpoint and logs, to send to another machine."""
    names = (CELL, ERROR, *(f"run/{name}" for name in RUN_FILES), SPEED)
    return {name: (where / name).read_bytes() for name in names if (where / name).exists()}


def unpack(where: Path, files: Mapping[str, bytes]) -> None:
    """The inverse of `pack`, which has what makes a run count as finished last."""
    for name, data in files.items():
        (where / name).parent.mkdir(parents=True, exist_ok=True)
        write_atomically(where / name, data)


def _cell(where: Path) -> Cell:
    with _naming(CELL):
        data = read_json(where / CELL, CellFile)
    if "network" not in data.config:
        raise RunDirectoryError(f"{where} was made by an earlier version", remedy="choose another {out}")
    with _naming(CELL):
        cell = Cell(data.arm, data.core, data.trainer, TrainConfig.from_json(data.config))
        if not cell.id == data.id == where.name:
            raise DamagedError(f"{CELL} describes another run than its folder's name")
        return cell


def _made_by(run: Path) -> dict[str, str]:
    """Commit and versions that a run was made with."""
    with _naming(RECORD):
        record = read_json(run / RECORD, Record)
        versions = {name: record.versions.get(name, "") for name in VERSIONS}
        return {"commit": str((record.git or {}).get("commit", "")), **versions}


def _finished(cell: Cell, row: Row, where: Path) -> Row:
    run = where / "run"
    with _naming(RESULT):
        result = read_json(run / RESULT, Scores)
        found: dict[str, Any] = {
            name: value for name, value in vars(result).items() if name not in ("eval_episodes", "probation")
        }
        if result.probation is not None:
            found["refused"] = int(not result.probation.accepted)
    with _naming(SPEED):
        speed = read_json(where / SPEED, Speed).forward_speed
        found["forward_speed"] = NAN if speed is None else speed
    if not (run / RECORD).exists():
        raise DamagedError(f"{RECORD} is missing")
    if cell.trained:
        with _naming(POLICY):
            load_state(run / POLICY)
        found |= _training(run, result)
    return replace(row, **found)


def _training(run: Path, result: Scores) -> dict[str, float]:
    """Measures of the training episodes, and a check that the tables end as the result says."""
    with _naming("evaluations.csv"):
        evaluations = columns(run, EvaluationRow)
        last = {name: values[-1] for name, values in evaluations.items()}
        if any(last[column] != getattr(result, name) for name, column in SCORES.items()):
            raise ValueError(f"it does not end with the evaluation that {RESULT} states")
    with _naming("episodes.csv"):
        returns = columns(run, EpisodeRow)["return"]
        trained = result.episodes - (result.probation.episodes if result.probation else 0)
        if len(returns) != trained:
            raise ValueError(f"it does not have the {trained} training episodes that {RESULT} counts")
    found = _over_the_run(evaluations, result.probation)
    if len(returns):
        found |= {"last_50_mean": float(np.mean(returns[-LAST:])), "all_mean": float(np.mean(returns))}
    return {name: round(value, 3) for name, value in found.items()}


def _over_the_run(evaluations: Mapping[str, NDArray[np.float64]], probation: Probation | None) -> dict[str, float]:
    """What the evaluations of a run come to, if there is more than the last one.

    On probation, which comes before them all, a run has no policy yet: its return is that of zero action.
    """
    if len(evaluations["steps"]) < 2:
        return {}
    steps, returns = evaluations["steps"], evaluations["return_mean"]
    found = {"first_return_mean": returns[0], "core_share": float(np.mean(evaluations["core"]))}
    if probation is not None and probation.zero:
        steps = np.concatenate(([0.0, steps[0]], steps))
        returns = np.concatenate(([np.mean(probation.zero)] * 2, returns))
    return found | {"area": stats.area(steps, returns)}


@contextmanager
def _naming(file: str) -> Iterator[None]:
    """Turn whatever a damaged file causes into one line that names it."""
    try:
        yield
    except DamagedError:
        raise
    except (TransferkitError, OSError, ValueError, LookupError, TypeError, AttributeError) as error:
        raise DamagedError(f"{file}: {type(error).__name__}: {error}") from error
