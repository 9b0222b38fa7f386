"""One trial: start a job, kill it, perhaps several times in a row, let it finish, and judge what is there."""

from __future__ import annotations

import os
import random
import signal
import time
from contextlib import suppress
from pathlib import Path
from typing import TYPE_CHECKING

from experiments.bench.forks import start, wait
from experiments.bench.kills.contents import contents, files, general
from experiments.bench.kills.points import Counter, Watch
from experiments.bench.kills.verdict import Reference, Verdict, check_kept, judge, read_whole

if TYPE_CHECKING:
    from experiments.bench.kills.jobs import Job
    from experiments.bench.kills.verdict import Place


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
        judge(place, whole, counter, verdict, kept)
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


def _finish(job: Job, place: Place, whole: Reference, verdict: Verdict, kept: dict[Path, bytes]) -> None:
    """Let the job finish, and compare with a run that nobody killed."""
    code = wait(_start(job, place, Counter(), None))
    if code:
        said = place.said.read_text().strip().splitlines()
        verdict.other.append(f"does not go on: exit code {code}: {said[-1] if said else 'no output'}")
        return
    check_kept(kept, verdict)
    found = read_whole(verdict, lambda: contents(place.folder))
    if found is not None:
        names = found.keys() | whole.found.keys()
        verdict.differing += sorted(name for name in names if found.get(name) != whole.found.get(name))
    more = {general(path, place.folder) for path in files(place.folder)} - whole.names
    verdict.other += [f"{name} is left over" for name in sorted(more)]
