"""The directory of one training run, complete on its own."""

from __future__ import annotations

import csv
import fcntl
import json
import os
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any, TextIO

from transferkit.errors import RunDirectoryError, RunInUseError
from transferkit.run.files import load_state, save_state, write_json, writing
from transferkit.versions import command, git_state, versions

RECORD, CHECKPOINT, POLICY, RESULT = "run.json", "checkpoint.safetensors", "policy.safetensors", "result.json"
TABLES: Mapping[str, Sequence[str]] = {
    "episodes": ("episode", "env_index", "return", "length", "terminated", "steps", "seconds"),
    "evaluations": ("episodes", "steps", "seconds", "return_mean", "return_std", "return_low", "return_high", "n"),
    "model": (
        "steps",
        "error_1",
        "error_5",
        "error_20",
        "disagreement",
        "reward_error",
        "termination_accuracy",
        "terminations_found",
    ),
}
ALWAYS = ("episodes", "evaluations")
"""Tables that are there from the start; another comes with its first row."""

LOCK = ".lock"
LEFTOVERS = (LOCK, RECORD + ".tmp")
"""What a start that was killed before it wrote its record leaves behind."""


class RunDirectory:
    """Files of a run: record, tables (episodes, evaluations, diagnoses of a model), checkpoint, final policy, result.

    Rows are appended as they happen; a checkpoint notes how long the tables were, and resuming cuts them back to it, so
    that the re-run steps write the same rows again.
    """

    def __init__(self, path: Path) -> None:
        """Use `create` or `resume`."""
        self.path = path
        self._lock = self._acquire()
        self._tables: dict[str, TextIO] = {}

    @classmethod
    def create(cls, path: Path, config: Mapping[str, Any]) -> RunDirectory:
        """Start a run in an empty or new folder.

        Raises:
            RunDirectoryError: the folder holds a run or other files, or is not writable.
        """
        if path.exists() and any(entry.name not in LEFTOVERS for entry in path.iterdir()):
            raise RunDirectoryError(f"output directory {path} is in use; continue it with --resume or pass another --out DIR")
        with writing(path):
            path.mkdir(parents=True, exist_ok=True)
        run = cls(path)
        if (path / RECORD).exists():
            raise RunInUseError(f"another process has just started {path}; continue it with --resume or pass another --out DIR")
        record = {
            "config": dict(config),
            "command": command(),
            "versions": versions(),
            "git": git_state(),
        }
        write_json(path / RECORD, record)
        for name in ALWAYS:
            run._open(name)
        return run

    @classmethod
    def resume(cls, path: Path, config: Mapping[str, Any]) -> tuple[RunDirectory, Any]:
        """Take up a run; returns it with the state of its last checkpoint, or None where there is none or the run is finished.

        Raises:
            RunDirectoryError: no run there, one with another configuration, or one that another process is writing.
        """
        record = read_json(path / RECORD)
        different = sorted(_differences(record["config"], json.loads(json.dumps(dict(config)))))
        if different:
            raise RunDirectoryError(
                f"run {path} was made with another configuration: {', '.join(different)}; resume with its own values, or "
                "start anew with another --out DIR"
            )
        run = cls(path)
        if run.result is not None:
            return run, None  # finished: its tables stay as they are
        state = load_state(path / CHECKPOINT) if (path / CHECKPOINT).exists() else None
        for name in TABLES:
            if run._table_path(name).exists():
                with writing(path):
                    os.truncate(run._table_path(name), state["tables"].get(name, 0) if state else 0)
                run._open(name)
        return run, state

    def append(self, table: str, row: Mapping[str, Any]) -> None:
        """Add one row to a table."""
        if table not in self._tables:
            self._open(table)
        with writing(self._table_path(table)):
            csv.DictWriter(self._tables[table], TABLES[table], lineterminator="\n").writerow(row)

    def checkpoint(self, state: Mapping[str, Any]) -> None:
        """Replace the checkpoint, after the rows it counts on are on the disk."""
        lengths = {}
        for name, file in self._tables.items():
            with writing(self._table_path(name)):
                file.flush()
                os.fsync(file.fileno())
            lengths[name] = file.tell()
        save_state(self.path / CHECKPOINT, {**state, "tables": lengths})

    def save_policy(self, state: Mapping[str, Any]) -> None:
        """Write the final policy."""
        save_state(self.path / POLICY, state)

    def finish(self, result: Mapping[str, Any]) -> None:
        """Write the result; a run with a result is finished."""
        write_json(self.path / RESULT, result)

    @property
    def result(self) -> dict[str, Any] | None:
        """The result of a finished run."""
        return read_json(self.path / RESULT) if (self.path / RESULT).exists() else None

    def close(self) -> None:
        """Release the directory."""
        for file in self._tables.values():
            file.close()
        self._lock.close()

    def _acquire(self) -> TextIO:
        with writing(self.path):
            lock = (self.path / LOCK).open("w")
        try:
            fcntl.flock(lock, fcntl.LOCK_EX | fcntl.LOCK_NB)
        except OSError:
            lock.close()
            raise RunInUseError(f"another process is writing {self.path}; wait for it or pass another --out DIR") from None
        return lock

    def _open(self, name: str) -> None:
        with writing(self._table_path(name)):
            file = self._table_path(name).open("a", buffering=1, newline="")
            self._tables[name] = file
            if file.tell() == 0:
                csv.writer(file, lineterminator="\n").writerow(TABLES[name])

    def _table_path(self, name: str) -> Path:
        return self.path / f"{name}.csv"


def read_table(path: Path, table: str) -> list[dict[str, float]]:
    """The rows of a run's table, all values as numbers."""
    with (path / f"{table}.csv").open(newline="") as file:
        return [{key: float(value) for key, value in row.items()} for row in csv.DictReader(file)]


def read_json(path: Path) -> dict[str, Any]:
    """A JSON file of a run.

    Raises:
        RunDirectoryError: it is missing or damaged.
    """
    try:
        return json.loads(path.read_text())
    except OSError:
        raise RunDirectoryError(f"{path.parent} holds no {path.name}; pass the --out DIR of a training run") from None
    except ValueError as error:
        raise RunDirectoryError(f"{path} is damaged ({error}); train again into another --out DIR") from None


def _differences(a: Mapping[str, Any], b: Mapping[str, Any], prefix: str = "") -> list[str]:
    found = []
    for key in {*a, *b}:
        left, right = a.get(key), b.get(key)
        if isinstance(left, dict) and isinstance(right, dict):
            found += _differences(left, right, f"{prefix}{key}.")
        elif left != right:
            found.append(f"{prefix}{key} is {left!r} there and {right!r} here")
    return found
