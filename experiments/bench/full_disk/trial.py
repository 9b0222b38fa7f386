"""One trial: run a command on a small disk, judge how it fails, make room, and run it again."""

from __future__ import annotations

import gc
import os
import subprocess
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING

from experiments.bench import forks
from experiments.bench.kills.contents import HalfWrittenError, contents, files, general

if TYPE_CHECKING:
    from experiments.bench.full_disk.cases import Case
    from experiments.bench.kills.contents import Found

ROOM = "64m"
USER_ERROR = 2
FULL = "No space left on device"
PROGRESS = " min left: "
"""In the lines of a matrix that are not errors."""


@dataclass(frozen=True)
class Place:
    """Where trials take place, one after the other, always under the same paths."""

    scratch: Path

    @property
    def disk(self) -> Path:
        """Where small disks are mounted."""
        return self.scratch / "disk"

    @property
    def inputs(self) -> Path:
        """What commands read."""
        return self.scratch / "inputs"

    def run(self, case: Case, out: Path, *, again: bool = False) -> tuple[int, str]:
        """Run a command in a forked process; returns exit code and stderr."""
        said = self.scratch / "stderr"
        said.unlink(missing_ok=True)

        def work() -> int:
            os.chdir(out)
            code = case.run(out, self.inputs, again=again)
            gc.collect()  # a file that cannot be flushed says so when it is forgotten
            return code

        code = forks.wait(forks.start(work, self.scratch / "stdout", said))
        return code, said.read_text()


def whole(case: Case, place: Place) -> Found:
    """What a command writes if there is room."""
    with disk(place, ROOM):
        code, said = place.run(case, place.disk)
        if code:
            raise RuntimeError(f"{case.name} fails on a disk with room: {said}")
        return contents(place.disk)


def make_input(case: Case, place: Place) -> None:
    """Keep what a command writes for other commands."""
    out = place.inputs / case.name
    out.mkdir()
    code, said = place.run(case, out)
    if code:
        raise RuntimeError(f"{case.name} fails: {said}")


def trial(case: Case, place: Place, expected: Found, size: int) -> tuple[bool, list[str]]:
    """Run a command on a disk of so many kB; returns whether it was too small, and what was wrong."""
    with disk(place, f"{size}k"):
        code, said = place.run(case, place.disk)
        if not code:
            return False, _differences(place, expected)
        wrong = [*_judge(code, said), *_half_written(place)]
        _mount("-o", f"remount,size={ROOM}", place.disk)
        code, said = place.run(case, place.disk, again=True)
        return True, wrong + ([f"does not go on: {said}"] if code else _differences(place, expected))


@contextmanager
def disk(place: Place, size: str) -> Iterator[None]:
    """Mount an empty disk of this size."""
    place.disk.mkdir(parents=True, exist_ok=True)
    _mount("-t", "tmpfs", "-o", f"size={size}", "tmpfs", place.disk)
    try:
        yield
    finally:
        subprocess.run(["umount", place.disk], check=True)


def _mount(*words: str | Path) -> None:
    subprocess.run(["mount", *words], check=True)


def _judge(code: int, said: str) -> list[str]:
    """What is wrong with how a command failed: it must exit with 2 and one line that names file, cause and remedy."""
    lines = [line for line in said.splitlines() if PROGRESS not in line]
    wrong = [] if code == USER_ERROR else [f"exit code {code}"]
    if len(lines) != 1:
        return [*wrong, f"{len(lines)} lines instead of one: {said.strip()!r}"]
    if FULL not in lines[0] or "cannot" not in lines[0] or ";" not in lines[0]:
        wrong.append(f"unclear: {lines[0]!r}")
    return wrong


def _half_written(place: Place) -> list[str]:
    try:
        contents(place.disk)
    except HalfWrittenError as error:
        return [f"half-written {error}"]
    return []


def _differences(place: Place, expected: Found) -> list[str]:
    """Files that differ from those of a run that had room, and files that are left over."""
    try:
        found = contents(place.disk)
    except HalfWrittenError as error:
        return [f"half-written {error}"]
    left = [general(path, place.disk) for path in files(place.disk) if path.suffix == ".tmp"]
    return [
        f"{name} differs" for name in sorted(found.keys() | expected.keys()) if found.get(name) != expected.get(name)
    ] + left
