"""What a trial found: files that are whole, rows and results that must stay, and what is wrong."""

from __future__ import annotations

import shutil
from collections.abc import Callable
from dataclasses import dataclass, field
from pathlib import Path
from typing import TYPE_CHECKING

from experiments.bench.kills.contents import HalfWrittenError, contents, files, general, recorded
from transferkit.run import load_state
from transferkit.run.directory import CHECKPOINT, RESULT
from transferkit.zoo.release import UNFINISHED

if TYPE_CHECKING:
    from experiments.bench.kills.contents import Found
    from experiments.bench.kills.points import Counter


@dataclass
class Verdict:
    """What a trial did, and what was wrong with it."""

    before_operation: int = 0
    at_random: int = 0
    lost: list[str] = field(default_factory=list)
    differing: list[str] = field(default_factory=list)
    other: list[str] = field(default_factory=list)

    @property
    def kills(self) -> int:
        """Of both kinds."""
        return self.before_operation + self.at_random


@dataclass(frozen=True)
class Reference:
    """A run that nobody killed."""

    found: Found
    names: frozenset[str]
    points: int
    seconds: float


@dataclass(frozen=True)
class Place:
    """Where trials take place, one after the other, always under the same paths."""

    scratch: Path

    @property
    def folder(self) -> Path:
        """What the job writes."""
        return self.scratch / "job"

    @property
    def journal(self) -> Path:
        """Names of the files that were renamed to their final name."""
        return self.scratch / "journal"

    @property
    def said(self) -> Path:
        """Output of the job."""
        return self.scratch / "said"

    def clear(self) -> None:
        """Start anew."""
        shutil.rmtree(self.folder, ignore_errors=True)
        self.folder.mkdir(parents=True)
        for path in (self.journal, self.said):
            path.unlink(missing_ok=True)


def judge(place: Place, whole: Reference, counter: Counter, verdict: Verdict, kept: dict[Path, bytes]) -> None:
    """Right after a kill: every file is whole or a temporary one, and what was reported as written is there."""
    read_whole(verdict, lambda: contents(place.folder))
    for path in files(place.folder):
        if general(path, place.folder).removesuffix(".tmp") not in whole.names:
            verdict.other.append(f"{path.name} is there after a kill")
    if place.journal.exists():
        promised = [name for name in place.journal.read_text().splitlines() if UNFINISHED not in name]
        verdict.lost += [f"{name} is gone" for name in promised if not (place.folder / name).exists()]
    _check_recordings(place, whole, counter.steps, verdict)
    check_kept(kept, verdict)
    _keep(place, kept)


def _check_recordings(place: Place, whole: Reference, flushed: int, verdict: Verdict) -> None:
    """The newest recording has at least the steps that were flushed, and no other than a whole one has."""
    for path in sorted(place.folder.glob("*.mcap"))[-1:]:
        steps = recorded(path).steps
        if len(steps) < flushed:
            verdict.lost.append(f"{flushed - len(steps)} of {flushed} flushed steps of {path.name}")
        if steps != whole.found["played.mcap"][: len(steps)]:
            verdict.differing.append(f"steps of {path.name}")


def _keep(place: Place, kept: dict[Path, bytes]) -> None:
    """Note rows up to the last checkpoint of each run, and results; from now on they must not change."""
    for path in files(place.folder):
        if path.name == CHECKPOINT and not (path.parent / RESULT).exists():
            for table, length in load_state(path)["tables"].items():
                rows = path.parent / f"{table}.csv"
                kept[rows] = rows.read_bytes()[:length]
                if len(kept[rows]) < length:
                    kept[rows] += b"rows that were fsynced"  # which no file begins with
        elif path.name == RESULT:
            kept[path] = path.read_bytes()


def check_kept(kept: dict[Path, bytes], verdict: Verdict) -> None:
    """What was noted earlier is still how its file begins."""
    there = {path for path, head in kept.items() if path.exists() and path.read_bytes().startswith(head)}
    verdict.lost += [f"{path.name} lost what it held" for path in kept.keys() - there]


def read_whole(verdict: Verdict, reading: Callable[[], Found]) -> Found | None:
    """Read a folder; a file that is half-written goes into the verdict."""
    try:
        return reading()
    except HalfWrittenError as error:
        verdict.other.append(f"half-written {error}")
        return None
