"""File operations of a process as points at which it can be killed."""

from __future__ import annotations

import functools
import io
import mmap
import os
import signal
import sys
from collections.abc import Callable
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

from transferkit.record.writer import Recorder
from transferkit.run import RunDirectory

EVENTS = ("os.rename", "os.remove", "os.mkdir", "os.rmdir", "os.truncate")
"""Audit events that change a folder; `open` only does so with one of these flags."""
CHANGING = os.O_WRONLY | os.O_RDWR | os.O_CREAT

CALLS = (
    (RunDirectory, "append"),
    *((Recorder, name) for name in ("__init__", "add_steps", "end_episode", "__exit__")),
)
"""Methods that write without an audit event."""


@dataclass
class Counter:
    """Numbers that outlive the process that counts."""

    memory: mmap.mmap = field(default_factory=lambda: mmap.mmap(-1, 16))

    @property
    def points(self) -> int:
        """Points that were passed."""
        return int.from_bytes(self.memory[:8], "little")

    @points.setter
    def points(self, value: int) -> None:
        self.memory[:8] = value.to_bytes(8, "little")

    @property
    def steps(self) -> int:
        """Steps of a recording that its writer handed to the operating system."""
        return int.from_bytes(self.memory[8:], "little")

    @steps.setter
    def steps(self, value: int) -> None:
        self.memory[8:] = value.to_bytes(8, "little")


@dataclass
class Watch:
    """Counts what this process does to a folder, and kills it right before one operation; there is no way back."""

    folder: Path
    journal: Path
    """File that gets the name of each file that was renamed to its final name."""
    counter: Counter
    fatal: int | None = None
    """Number of the operation, from 1; None never kills."""

    def start(self) -> None:
        """Watch from now on."""
        sys.addaudithook(self._heard)
        io.open = self._opening(io.open)  # pathlib's
        os.fsync = self._syncing(os.fsync)
        os.replace = os.rename = self._renaming(os.replace)
        for owner, name in CALLS:
            setattr(owner, name, self._calling(getattr(owner, name)))

    def _point(self, before: Callable[[], object] = int) -> None:
        self.counter.points += 1
        if self.counter.points == self.fatal:
            before()
            os.kill(os.getpid(), signal.SIGKILL)

    def _inside(self, path: object) -> bool:
        return isinstance(path, str | os.PathLike) and os.path.abspath(path).startswith(f"{self.folder}{os.sep}")

    def _heard(self, event: str, values: tuple[Any, ...]) -> None:
        changes = event in EVENTS or (event == "open" and isinstance(values[2], int) and values[2] & CHANGING)
        if changes and self._inside(values[0]):
            self._point()

    def _opening(self, real: Callable[..., Any]) -> Callable[..., Any]:
        """A point right after a file was opened to be written: it is there and has nothing in it."""

        @functools.wraps(real)
        def opened(path: object, *more: Any, **named: Any) -> object:  # noqa: ANN401 - passed on
            file = real(path, *more, **named)
            if self._inside(path) and file.writable():
                self._point()
            return file

        return opened

    def _syncing(self, real: Callable[[int], None]) -> Callable[[int], None]:
        """A point when half of a temporary file is written, and one when all of it is."""

        def synced(descriptor: int) -> None:
            name = Path(f"/proc/self/fd/{descriptor}").readlink()
            if self._inside(name):
                if name.suffix == ".tmp":
                    self._point(lambda: os.ftruncate(descriptor, os.fstat(descriptor).st_size // 2))
                self._point()
            real(descriptor)

        return synced

    def _renaming(self, real: Callable[..., None]) -> Callable[..., None]:
        """Note what is there for good; the renaming itself is an audit event."""

        def renamed(source: str, target: str, **named: Any) -> None:  # noqa: ANN401 - passed on
            real(source, target, **named)
            if self._inside(target):
                with self.journal.open("a") as file:
                    file.write(f"{os.path.relpath(target, self.folder)}\n")

        return renamed

    def _calling(self, real: Callable[..., Any]) -> Callable[..., Any]:
        @functools.wraps(real)
        def called(owner: Any, *more: Any, **named: Any) -> object:  # noqa: ANN401 - passed on
            self._point()
            answer = real(owner, *more, **named)
            if isinstance(owner, Recorder):
                self.counter.steps = owner.steps
            return answer

        return called
