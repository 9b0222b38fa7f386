"""The directory of one training run, complete on its own."""

from __future__ import annotations

import csv
import fcntl
import hashlib
import json
import os
from collections.abc import Mapping
from dataclasses import asdict
from pathlib import Path
from types import TracebackType
from typing import TYPE_CHECKING, Any, TextIO

from transferkit.errors import RunDirectoryError, RunInUseError
from transferkit.files import damaged_run, read_json, write_json, writing
from transferkit.reading import Count, FormatError, typed
from transferkit.run.continuation import (
    CHECKPOINT,
    continue_run,
    earlier_results,
    finished_result,
    recorded_limits,
)
from transferkit.run.result import RECORD, RESULT, MadeOf, Record
from transferkit.run.state_file import load_state, save_state
from transferkit.run.tables import ALWAYS, TABLES
from transferkit.versions import command, git_state, versions

if TYPE_CHECKING:
    from transferkit.budget import Budget
    from transferkit.run.result import Earlier, Result
    from transferkit.run.tables import Row

POLICY, BEST, UNTRAINED = "policy.safetensors", "best.safetensors", "untrained.safetensors"
"""The policy that a run ended with, the one that its evaluations during training found best, and the core as it was wrapped."""

LONGEST_HEADER = 1000
"""Characters of a table's first line that are looked at."""

LOCK = ".lock"
OVERRIDES = "overrides"
"""Settings over the preset, in a run's identity."""

LEFTOVERS = (LOCK, RECORD + ".tmp")
"""Files that a start leaves behind if it is killed before it wrote its record."""


class RunDirectory:
    """Files of a run: record, tables (episodes, evaluations, diagnoses of a model), checkpoint, final policy, result.

    Rows are appended as they happen. A checkpoint notes how long the tables were, and resuming cuts them back to it, so that
    the steps that run again write the same rows again. As a context it releases the directory at its end.
    """

    def __init__(self, path: Path) -> None:
        """Use `create` or `resume`."""
        self.path = path
        self._check_regular()
        self._lock = self._acquire()
        self._tables: dict[str, TextIO] = {}
        self._widths: dict[str, int] = {}

    @classmethod
    def create(cls, path: Path, config: Mapping[str, Any]) -> RunDirectory:
        """Start a run in an empty or new folder.

        Raises:
            RunDirectoryError: the folder holds a run or other files, or is not writable.
        """
        check_free(path)
        with writing(path):
            path.mkdir(parents=True, exist_ok=True)
        run = cls(path)
        try:
            run._start(config)
        except BaseException:
            run.close()
            raise
        return run

    @classmethod
    def resume(cls, path: Path, budget: Budget | None = None) -> tuple[RunDirectory, dict[str, Any] | None]:
        """Take up a run; returns it with the state of its last checkpoint, or None if there is none or the run is finished.

        A finished run goes on from its end if the budget is more than it has spent.

        Raises:
            RunDirectoryError: no run is there, another process is writing it, or the budget is neither its own nor more.
        """
        run = cls(path)
        try:
            return run, run._take_up(budget)
        except BaseException:
            run.close()
            raise

    def append(self, row: Row) -> None:
        """Add one row to its table."""
        kind = type(row)
        if kind.table not in self._tables:
            self._open(kind)
        with writing(kind.file(self.path)):
            csv.writer(self._tables[kind.table], lineterminator="\n").writerow(row.values()[: self._widths[kind.table]])

    def checkpoint(self, state: Mapping[str, Any]) -> None:
        """Replace the checkpoint, after the rows it counts on are on the disk."""
        lengths = {}
        for name, file in self._tables.items():
            with writing(self.path / f"{name}.csv"):
                file.flush()
                os.fsync(file.fileno())
            lengths[name] = file.tell()
        save_state(self.path / CHECKPOINT, {**state, "tables": lengths})

    def save_policy(self, state: Mapping[str, Any], file: str = POLICY) -> None:
        """Write the final policy, or another one."""
        save_state(self.path / file, state)

    def finish(self, result: Result) -> Result:
        """Write the result with the checksums of the tables, and return it; a run with a result is finished."""
        paths = [kind.file(self.path) for kind in TABLES if kind.table in self._tables]
        files = {path.name: hashlib.sha256(path.read_bytes()).hexdigest() for path in paths}
        write_json(self.path / RESULT, {**asdict(result), "files": files})
        return result

    @property
    def result(self) -> Result | None:
        """The result of a finished run."""
        return finished_result(self.path)

    @property
    def earlier(self) -> tuple[Earlier, ...]:
        """What the run came to each time before it was given more budget."""
        return earlier_results(self.path)

    def close(self) -> None:
        """Release the directory."""
        for file in self._tables.values():
            file.close()
        self._lock.close()

    def __enter__(self) -> RunDirectory:
        return self

    def __exit__(self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None) -> None:
        self.close()

    def _start(self, config: Mapping[str, Any]) -> None:
        if is_run(self.path):
            raise RunInUseError(
                f"another process has just started {self.path}",
                remedy="continue it with {resume=True}, or choose another {out}",
            )
        about = {"config": dict(config), "command": command(), "versions": versions(), "git": git_state()}
        write_json(self.path / RECORD, about)
        for kind in ALWAYS:
            self._open(kind)

    def _take_up(self, budget: Budget | None) -> dict[str, Any] | None:
        limits, own = budget and budget.limits(), recorded_limits(self.path)
        if self.result is not None:
            if budget is None or limits == own:
                return None  # finished: its tables stay as they are
            continue_run(self.path, self.result, budget)
        elif limits is not None:
            check_same(self.path, own, limits)
        with writing(self.path / RESULT):
            (self.path / RESULT).unlink(missing_ok=True)  # of before the run was given more budget; the record has it
        state = load_state(self.path / CHECKPOINT) if (self.path / CHECKPOINT).exists() else None
        self._cut_tables({} if state is None else self._lengths(state))
        return state

    def _cut_tables(self, lengths: Mapping[str, int]) -> None:
        for kind in TABLES:
            if kind.file(self.path).exists():
                with writing(self.path):
                    os.truncate(kind.file(self.path), lengths.get(kind.table, 0))
                self._open(kind)
            elif kind in ALWAYS:  # the start was killed right after it wrote the record
                self._open(kind)

    def _check_regular(self) -> None:
        """Refuse links, pipes and devices, which a folder from a stranger may have in place of files that are written."""
        names = (LOCK, RECORD, CHECKPOINT, POLICY, BEST, UNTRAINED, RESULT, *(kind.file(self.path).name for kind in TABLES))
        for path in (self.path / name for name in names):
            if path.is_symlink() or (path.exists() and not path.is_file()):
                raise RunDirectoryError(f"{path} is not a regular file", remedy="choose another {out}")

    def _acquire(self) -> TextIO:
        with writing(self.path):
            lock = (self.path / LOCK).open("w")
        try:
            fcntl.flock(lock, fcntl.LOCK_EX | fcntl.LOCK_NB)
        except OSError:
            lock.close()
            raise RunInUseError(
                f"another process is writing {self.path}", remedy="wait for it, or choose another {out}"
            ) from None
        return lock

    def _open(self, kind: type[Row]) -> None:
        with writing(kind.file(self.path)):
            file = kind.file(self.path).open("a", buffering=1, newline="")
            self._tables[kind.table] = file
            if file.tell() == 0:
                csv.writer(file, lineterminator="\n").writerow(kind.columns())
        with kind.file(self.path).open(encoding="ascii", errors="replace") as whole:
            self._widths[kind.table] = whole.readline(LONGEST_HEADER).count(",") + 1  # an earlier version's table goes on

    def _lengths(self, state: Mapping[str, Any]) -> dict[str, int]:
        """How long the tables were when a checkpoint was written; none may be shorter now."""
        with damaged_run(self.path / CHECKPOINT):
            lengths = typed(state.get("tables"), dict[str, Count])
        for kind in TABLES:
            if lengths.get(kind.table, 0) > (kind.file(self.path).stat().st_size if kind.file(self.path).exists() else 0):
                raise RunDirectoryError(
                    f"{kind.file(self.path)} is shorter than when the checkpoint was written",
                    remedy="train again into another {out}",
                )
        return lengths


def read_record(run: Path) -> dict[str, Any]:
    """Read the configuration that a run was started with, and what else its record says of it.

    Raises:
        RunDirectoryError: there is no run, or its record is damaged.
    """
    return read_json(run / RECORD, Record).config


def read_made_of(record: Mapping[str, Any]) -> MadeOf:
    """Take what a training run's record has beside the configuration.

    Raises:
        RunDirectoryError: it is the record of something else.
    """
    try:
        return typed(record, MadeOf)
    except FormatError as error:
        raise RunDirectoryError(f"{RECORD} is not the record of a training run ({error})", remedy="train again") from None


def check_free(path: Path) -> None:
    """Check that a folder is empty or yet to be made.

    Raises:
        RunDirectoryError: it holds a run or other files, or no folder has such a name.
    """
    if "\0" in str(path):
        raise RunDirectoryError("no folder has a name with a null character", remedy="choose another {out}")
    if os.path.exists(path) and any(entry.name not in LEFTOVERS for entry in path.iterdir()):
        if is_run(path):
            remedy = "continue it with {resume=True}, or choose another {out}"
            raise RunDirectoryError(f"output directory {path} is in use", remedy=remedy)
        raise RunDirectoryError(f"output directory {path} is in use by other files than a run's", remedy="choose another {out}")


def is_run(path: str | Path) -> bool:
    """Whether a training run was started in this folder, whatever its name: a path's own `exists` raises for one too long."""
    return os.path.exists(Path(path) / RECORD)


def named_run(path: str | Path) -> tuple[Path, bool] | None:
    """The run that its folder or one of its policy files names, and whether it is the file of its best policy."""
    own = Path(path)
    if own.name in (POLICY, BEST) and is_run(own.parent):
        return own.parent, own.name == BEST
    return (own, False) if is_run(own) else None


def check_same(path: Path, recorded: Mapping[str, Any], config: Mapping[str, Any]) -> None:
    """Compare the configuration that a run was started with and the one it is to go on with.

    Raises:
        RunDirectoryError: they differ.
    """
    config = json.loads(json.dumps(dict(config)))
    different = sorted(_differences(recorded, config))
    different = [what for what in different if not what.startswith("policy.")] or different  # which only follows from them
    if different:
        raise RunDirectoryError(
            f"run {path} was made with another configuration: {', '.join(different)}",
            remedy="resume with its own values, or start anew with another {out}",
        )


def _differences(a: Mapping[str, Any], b: Mapping[str, Any], prefix: str = "") -> list[str]:
    differences = []
    for key in {*a, *b}:
        left, right = a.get(key), b.get(key)
        if key == OVERRIDES:  # None if there are none
            differences += _differences(left or {}, right or {}, f"{prefix}{key}.")
        elif isinstance(left, dict) and isinstance(right, dict):
            differences += _differences(left, right, f"{prefix}{key}.")
        elif left != right:
            differences.append(f"{prefix}{key} is {left!r} there and {right!r} here")
    return differences
