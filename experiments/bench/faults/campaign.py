"""`python -m experiments.bench faults --mutants 1000000 --seed 0 --out faults.json`: damaged and forged files of every format.

Each mutant is read in a process of its own kind that may take 1 GB and 10 seconds. It must be refused in one line, read as what
was written (damaged), or read as data that can be used (forged); anything else is counted as wrong, and ends with exit code 1.
The same command goes on. `--only K` runs one mutant again and shows what it does.
"""

from __future__ import annotations

import argparse
import os
import resource
import select
import signal
import sys
import tempfile
import time
import traceback
import warnings
from collections import Counter
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from transferkit.errors import TransferkitError
from transferkit.files import read_json, write_json
from transferkit.table import format_table

if TYPE_CHECKING:
    from experiments.bench.faults.formats import Format

BATCH, SECONDS, BYTES = 2000, 10.0, 2**30
OUTCOMES = ("equal", "usable", "refused", "wrong")
HEADER = ("format", "mutants", "read as written", "forged and usable", "refused in one line", "anything else")
SHOWN = 50


@dataclass
class Found:
    """What is known so far; `done` counts mutants from 0."""

    seed: int
    done: int = 0
    counts: dict[str, dict[str, int]] = field(default_factory=dict)
    problems: list[str] = field(default_factory=list)


def command(arguments: Sequence[str]) -> int:
    """Go on until there are enough mutants; the exit code is 1 if anything went wrong."""
    parser = argparse.ArgumentParser("experiments.bench faults", description=__doc__)
    parser.add_argument("--mutants", type=int, default=10_000)
    parser.add_argument("--seed", type=int, default=0)
    parser.add_argument("--out", type=Path, help="JSON with what was found; the same command goes on")
    parser.add_argument("--workers", type=int, default=2)
    parser.add_argument("--only", type=int, metavar="K", help="one mutant, with its traceback")
    options = parser.parse_args(arguments)
    warnings.simplefilter("ignore")
    memory = Path("/dev/shm")  # a file there costs nothing
    with tempfile.TemporaryDirectory(dir=memory if memory.is_dir() else None) as scratch:
        campaign = Campaign(Path(scratch), options.seed)
        if options.only is not None:
            print(campaign.trial(options.only, Path(scratch) / "only"))
            return 0
        found = _load(options.out, options.seed)
        campaign.run(found, options.mutants, options.workers, options.out)
    print(table(found))
    print("\n".join(found.problems), end="\n" if found.problems else "")
    return 1 if any(counts.get("wrong") for counts in found.counts.values()) else 0


def table(found: Found) -> str:
    """A row for each format, and their sum."""
    total: Counter[str] = Counter()
    for counts in found.counts.values():
        total.update(counts)
    rows = [*sorted(found.counts.items()), ("all", total)]
    return format_table(HEADER, [(name, sum(own.values()), *(own.get(what, 0) for what in OUTCOMES)) for name, own in rows])


class Campaign:
    """Samples of all formats, what is read of them, and trials by number."""

    def __init__(self, scratch: Path, seed: int) -> None:
        from experiments.bench.faults.samples import formats  # noqa: PLC0415 - takes seconds, after `--help`

        self.scratch, self.seed = scratch, seed
        self.formats: list[Format] = formats(scratch / "samples")
        self.whole = [kind.read_whole(scratch / "whole" / str(k)) for k, kind in enumerate(self.formats)]
        shares = np.array([kind.share for kind in self.formats])
        self._shares = shares / shares.sum()

    def trial(self, number: int, work: Path) -> str:
        """What becomes of a mutant.

        Raises:
            TransferkitError: it is refused.
        """
        random = np.random.default_rng([self.seed, number])
        k = int(random.choice(len(self.formats), p=self._shares))
        return self.formats[k].trial(work, self.whole[k], random)

    def name(self, number: int) -> str:
        """The format of a mutant."""
        return self.formats[int(np.random.default_rng([self.seed, number]).choice(len(self.formats), p=self._shares))].name

    def run(self, found: Found, mutants: int, workers: int, out: Path | None) -> None:
        """Try mutants in forked processes, each a batch of them, and keep what they find."""
        started, before, said = time.monotonic(), found.done, 0.0
        while found.done < mutants:
            starts = range(found.done, min(mutants, found.done + workers * BATCH), BATCH)
            batches = [Batch(self, range(start, min(mutants, start + BATCH))) for start in starts]
            while any(batch.left for batch in batches):
                select.select([batch.pipe for batch in batches if batch.left], [], [], 0.5)
                for batch in batches:
                    batch.collect(found)
            found.done = batches[-1].numbers.stop
            if out is not None:
                write_json(out, vars(found))
            if time.monotonic() - said > 10:
                said = time.monotonic()
                left = (mutants - found.done) * (said - started) / (found.done - before) / 60
                wrong = sum(counts.get("wrong", 0) for counts in found.counts.values())
                print(f"{found.done} of {mutants}, {wrong} wrong, {left:.0f} min left", file=sys.stderr, flush=True)


class Batch:
    """Mutants that a forked process tries one after the other; another process takes over if it hangs or dies."""

    def __init__(self, campaign: Campaign, numbers: range) -> None:
        self.numbers, self.left, self._campaign = numbers, numbers, campaign
        self._start()

    def collect(self, found: Found) -> None:
        """Book what the process has said since the last time."""
        if not self.left:
            return
        data = os.read(self.pipe, 2**20) if select.select([self.pipe], [], [], 0)[0] else None
        if data:
            self._heard, self._used = time.monotonic(), _processor_seconds(self._child)
            *lines, self._rest = (self._rest + data.decode()).split("\n")
            for line in lines:
                self._book(found, line)
        elif data is not None:  # the pipe is closed, and something is left
            _, status = os.waitpid(self._child, 0)
            self._book(found, f"wrong\tthe process ended with {os.waitstatus_to_exitcode(status)}")
            self._again()
        elif self._hangs():
            os.kill(self._child, signal.SIGKILL)
            os.waitpid(self._child, 0)
            self._book(found, f"wrong\tit took more than {SECONDS:.0f} seconds of the processor, or ten times as long")
            self._again()
        if not self.left:
            os.close(self.pipe)
            os.waitpid(self._child, 0)

    def _hangs(self) -> bool:
        """Whether the mutant has used up its seconds, which on a busy machine take longer."""
        waited = time.monotonic() - self._heard
        return waited > SECONDS and (waited > 10 * SECONDS or _processor_seconds(self._child) - self._used > SECONDS)

    def _book(self, found: Found, line: str) -> None:
        outcome, _, what = line.partition("\t")
        number, self.left = self.left[0], self.left[1:]
        name = self._campaign.name(number)
        counts = found.counts.setdefault(name, {})
        counts[outcome] = counts.get(outcome, 0) + 1
        if outcome == "wrong" and len(found.problems) < SHOWN:
            found.problems.append(f"mutant {number} of {name}: {what}")

    def _again(self) -> None:
        os.close(self.pipe)
        if self.left:
            self._start()
        else:
            self.pipe, self._child = os.pipe()[0], os.fork() or os._exit(0)

    def _start(self) -> None:
        self.pipe, end = os.pipe()
        self._heard, self._used, self._rest = time.monotonic(), 0.0, ""
        self._child = os.fork()
        if self._child:
            os.close(end)
            return
        try:
            _limit_memory()
            for line in _lines(self._campaign, self.left):
                os.write(end, line.encode())
        finally:
            os._exit(0)


def _lines(campaign: Campaign, numbers: range) -> Iterator[str]:
    quiet = os.open(os.devnull, os.O_WRONLY)
    os.dup2(quiet, 1), os.dup2(quiet, 2)
    work = campaign.scratch / f"work{os.getpid()}"
    for number in numbers:
        yield f"{_outcome(campaign, number, work)}\n"


def _outcome(campaign: Campaign, number: int, work: Path) -> str:
    try:
        return campaign.trial(number, work)
    except TransferkitError as error:
        text = str(error)
        return "refused" if text.isprintable() else f"wrong\tmore than a line: {text!r}"
    except BaseException as error:  # the point of it
        frame = traceback.extract_tb(error.__traceback__)[-1]
        reason = " ".join(f"{type(error).__name__}: {error}".split())[:300]
        return f"wrong\t{reason} ({Path(frame.filename).name}:{frame.lineno})".encode(errors="replace").decode()


def _processor_seconds(process: int) -> float:
    fields = Path(f"/proc/{process}/stat").read_text().rpartition(") ")[2].split()
    return (int(fields[11]) + int(fields[12])) / os.sysconf("SC_CLK_TCK")


def _limit_memory() -> None:
    pages = int(Path("/proc/self/statm").read_text().split()[0])
    most = pages * resource.getpagesize() + BYTES
    resource.setrlimit(resource.RLIMIT_AS, (most, most))


def _load(out: Path | None, seed: int) -> Found:
    if out is None or not out.exists():
        return Found(seed)
    found = read_json(out, Found)
    if found.seed != seed:
        raise SystemExit(f"{out} has seed {found.seed}; go on with it, or choose another --out")
    return found
