"""`python -m experiments.bench kills --kills 1000 --seed 0 --out kills.json`: many trials, and a table of what they found."""

from __future__ import annotations

import argparse
import random
import sys
import tempfile
import time
from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any

from experiments.bench.forks import warm_up
from experiments.bench.kills.jobs import JOBS
from experiments.bench.kills.trial import reference, trial
from experiments.bench.kills.verdict import Place
from transferkit.errors import ConfigError
from transferkit.files import read_json, write_json
from transferkit.table import format_table

if TYPE_CHECKING:
    from experiments.bench.kills.jobs import Job
    from experiments.bench.kills.verdict import Reference, Verdict

COUNTS = ("kills", "before_operation", "at_random", "resumed", "lost", "differing", "other")
HEADER = ("job", "kills", "before a file operation", "at a random time", "resumed", "lost", "differing", "other", "operations")
WRONG = ("lost", "differing", "other")
MOST_PROBLEMS = 100


def command(arguments: Sequence[str]) -> int:
    """Go on until there are enough kills; the exit code is 1 if anything was lost, differs, or is wrong otherwise."""
    parser = argparse.ArgumentParser("experiments.bench kills", description=__doc__)
    parser.add_argument("--kills", type=int, default=1000, help="how many, over all jobs; by default %(default)s")
    parser.add_argument("--seed", type=int, default=0)
    parser.add_argument("--out", type=Path, required=True, help="JSON with what was found; the same command goes on")
    parser.add_argument("--jobs", nargs="+", choices=[job.name for job in JOBS], help="these only; by default all")
    options = parser.parse_args(arguments)
    record = _load(options.out, options.seed)
    jobs = [job for job in JOBS if options.jobs is None or job.name in options.jobs]
    warm_up([job.name for job in jobs])
    campaign(jobs, options.kills, record, options.out)
    print(table(record))
    print("\n".join(record["problems"]), end="\n" if record["problems"] else "")
    return 1 if any(row[name] for row in record["jobs"].values() for name in WRONG) else 0


def campaign(jobs: Sequence[Job], kills: int, record: dict[str, Any], out: Path) -> None:
    """Kill every job as often as its share says."""
    shares = sum(job.share for job in jobs)
    goals = {job.name: -(-kills * job.share // shares) for job in jobs}
    progress = Progress(sum(goals.values()), sum(_row(record, job)["kills"] for job in jobs))
    memory = Path("/dev/shm")  # a file there costs nothing, and a kill is the same
    with tempfile.TemporaryDirectory(dir=memory if memory.is_dir() else None) as scratch:
        place = Place(Path(scratch))
        for job in jobs:
            whole = reference(job, place) if _row(record, job)["kills"] < goals[job.name] else None
            while whole and _row(record, job)["kills"] < goals[job.name]:
                verdict = _next(job, place, whole, record)
                write_json(out, record)
                progress.say(job.name, verdict)


class Progress:
    """Lines on stderr with the time left."""

    def __init__(self, goal: int, before: int) -> None:
        self._goal, self._done, self._new = goal, before, 0
        self._started = self._last = time.monotonic()

    def say(self, name: str, verdict: Verdict) -> None:
        """Count a trial, and print a line now and then."""
        self._done, self._new, now = self._done + verdict.kills, self._new + verdict.kills, time.monotonic()
        if now - self._last >= 10 and self._new:
            left = max(0, self._goal - self._done) * (now - self._started) / self._new
            print(f"{self._done} of {self._goal} kills, {left / 60:.0f} min left: {name}", file=sys.stderr, flush=True)
            self._last = now


def table(record: dict[str, Any]) -> str:
    """A row for each job, and their sum."""
    rows = [
        (name, *(row[count] for count in COUNTS), f"{len(row['met'])} of {row['operations']}")
        for name, row in record["jobs"].items()
    ]
    total = ("all", *(sum(row[count] for row in record["jobs"].values()) for count in COUNTS), "")
    return format_table(HEADER, [*rows, total])


def _next(job: Job, place: Place, whole: Reference, record: dict[str, Any]) -> Verdict:
    """One trial more; its first kill is before an operation that no trial has met yet, if there is one."""
    row = _row(record, job)
    chance = random.Random(f"{record['seed']}/{job.name}/{row['trials']}")
    row["operations"] = whole.points
    unmet = [k for k in range(1, whole.points + 1) if k not in row["met"]]
    point = unmet[0] if unmet and chance.random() < 0.8 else None
    verdict = trial(job, place, whole, chance, point)
    row["met"] += [] if point is None else [point]
    row["trials"] += 1
    row["resumed"] += not any("does not go on" in what for what in verdict.other)
    for name in ("kills", "before_operation", "at_random"):
        row[name] += getattr(verdict, name)
    for name in WRONG:
        row[name] += bool(getattr(verdict, name))
        room = MOST_PROBLEMS - len(record["problems"])
        found = [f"{job.name}, trial {row['trials']}, operation {point}: {name}: {what}" for what in getattr(verdict, name)]
        record["problems"] += found[:room]
    return verdict


def _row(record: dict[str, Any], job: Job) -> dict[str, Any]:
    return record["jobs"].setdefault(job.name, dict.fromkeys(COUNTS, 0) | {"trials": 0, "operations": 0, "met": []})


def _load(out: Path, seed: int) -> dict[str, Any]:
    if not out.exists():
        return {"seed": seed, "jobs": {}, "problems": []}
    record = read_json(out, dict)
    if record["seed"] != seed:
        raise ConfigError(f"{out} has seed {record['seed']}", remedy="go on with it, or choose another {out}")
    return record
