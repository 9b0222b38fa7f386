"""One trial: start a job, kill it, perhaps several times in a row, let it finish, and judge what is there."""

from __future__ import annotations

import os
import random
import shutil
import signal
import time
from collections.abc import Callable
from contextlib import suppress
from dataclasses import dataclass, field
from pathlib import Path
from typing import TYPE_CHECKING

from experiments.bench.forks import start, wait
from experiments.bench.kills.contents import HalfWrittenError, contents, files, general, recorded
from experiments.bench.kills.points import Counter, Watch
from transferkit.pretrain import UNFINISHED
from transferkit.run import load_state
from transferkit.run.directory import CHECKPOINT, RESULT

if TYPE_CHECKING:
    from experiments.bench.kills.contents import Found
    from experiments.bench.kills.jobs import Job


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


def reference(job: Job, place: Place) -> Reference:
    """Run a job without a kill."""
    place.clear()
    counter, started = Counter(), time.monotonic()
    if wait(_start(job, place, counter, None)) != 0:
        raise RuntimeError(f"{job.name} fails without a kill: {place.said.read_text()}")
    seconds = time.monotonic() - started
    names = frozenset(general(path, place.folder) for path in files(place.folder))
    return Reference(contents(place.folder), names, counter.points, seconds)


def trial(job: Job, place: Place, whole: Reference, chance: random.Random, point: int | None) -> Verdict:
    """Kill a job, first before the operation `point` if there is one, up to three times more, and let it finish."""
    place.clear()
    verdict, kept, counter = Verdict(), {}, Counter()
    for k in range(chance.randint(1, 2 if job.processes else 4)):
        counter.points = counter.steps = 0
        if k or point is None:
            point = chance.randint(1, whole.points) if whole.points and chance.random() < 0.5 else None
        if not _kill(job, place, counter, point, chance.random() * whole.seconds, chance):
            break
        verdict.before_operation += point is not None
        verdict.at_random += point is None
        _judge(place, whole, counter, verdict, kept)
    _finish(job, place, whole, verdict, kept)
    return verdict


def _start(job: Job, place: Place, counter: Counter, fatal: int | None) -> int:
    def work() -> None:
        if not job.processes:
            Watch(place.folder, place.journal, counter, fatal).start()
        job.run(place.folder)

    return start(work, place.said)


def _kill(job: Job, place: Place, counter: Counter, point: int | None, delay: float, chance: random.Random) -> bool:
    """Start a job and kill it; False if it was finished before."""
    child = _start(job, place, counter, point)
    if point is not None:
        return wait(child) == -signal.SIGKILL
    time.sleep(delay)
    others = _descendants(child)
    if chance.random() < 0.5:
        others = []  # workers see that their parent is gone, save, and stop
    for process in (child, *others):
        with suppress(ProcessLookupError):
            os.kill(process, signal.SIGKILL)
    return wait(child) == -signal.SIGKILL


def _descendants(process: int) -> list[int]:
    listed = Path(f"/proc/{process}/task/{process}/children")
    children = [int(text) for text in listed.read_text().split()] if listed.exists() else []
    return [*children, *(each for child in children for each in _descendants(child))]


def _judge(place: Place, whole: Reference, counter: Counter, verdict: Verdict, kept: dict[Path, bytes]) -> None:
    """Right after a kill: every file is whole or a temporary one, and what was reported as written is there."""
    _try(verdict, lambda: contents(place.folder))
    for path in files(place.folder):
        if general(path, place.folder).removesuffix(".tmp") not in whole.names:
            verdict.other.append(f"{path.name} is there after a kill")
    if place.journal.exists():
        promised = [name for name in place.journal.read_text().splitlines() if UNFINISHED not in name]
        verdict.lost += [f"{name} is gone" for name in promised if not (place.folder / name).exists()]
    _check_recordings(place, whole, counter.steps, verdict)
    _check_kept(kept, verdict)
    _keep(place, kept)


def _check_recordings(place: Place, whole: Reference, flushed: int, verdict: Verdict) -> None:
    """The newest recording has at least the steps that were flushed, and no other than a whole one has."""
    for path in sorted(place.folder.glob("*.mcap"))[-1:]:
        steps = recorded(path).steps
        if len(steps) < flushed:
            verdict.lost.append(f"{flushed - len(steps)} of {flushed} flushed steps of {path.name}")
        if steps != whole.found["played.mcap"]["steps"][: len(steps)]:
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


def _check_kept(kept: dict[Path, bytes], verdict: Verdict) -> None:
    verdict.lost += [
        f"{path.name} lost what it held"
        for path, head in kept.items()
        if not (path.exists() and path.read_bytes().startswith(head))
    ]


def _finish(job: Job, place: Place, whole: Reference, verdict: Verdict, kept: dict[Path, bytes]) -> None:
    """Let the job finish, and compare with a run that nobody killed."""
    code = wait(_start(job, place, Counter(), None))
    if code:
        said = place.said.read_text().strip().splitlines()
        verdict.other.append(f"does not go on: exit code {code}: {said[-1] if said else 'no output'}")
        return
    _check_kept(kept, verdict)
    found = _try(verdict, lambda: contents(place.folder))
    if found is not None:
        names = found.keys() | whole.found.keys()
        verdict.differing += sorted(name for name in names if found.get(name) != whole.found.get(name))
    more = {general(path, place.folder) for path in files(place.folder)} - whole.names
    verdict.other += [f"{name} is left over" for name in sorted(more)]


def _try(verdict: Verdict, reading: Callable[[], Found]) -> Found | None:
    try:
        return reading()
    except HalfWrittenError as error:
        verdict.other.append(f"half-written {error}")
        return None
