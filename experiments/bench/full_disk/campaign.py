"""`python -m experiments.bench full-disk`: every command that writes, on disks of many sizes, and a table of how they fail.

Disks are mounted in a namespace of their own, which root may make, and others where the system lets users have namespaces.
"""

from __future__ import annotations

import argparse
import os
import random
import subprocess
import sys
import tempfile
import time
from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING

from transferkit.errors import ConfigError
from transferkit.table import format_table

if TYPE_CHECKING:
    from experiments.bench.full_disk.cases import Case
    from experiments.bench.full_disk.trial import Place

SIZES = tuple(2**k for k in range(2, 11))
"""kB."""
INSIDE = "TRANSFERKIT_BENCH_NAMESPACE"
"""Environment variable that is set in a namespace of our own."""
WAYS = (("unshare", "-m"), ("unshare", "-rm"))
"""As root, and as a user."""
HEADER = ("command", "disks", "too small", "wrong")


def command(arguments: Sequence[str]) -> int:
    """Run the trials; the exit code is 1 if a command failed in another way than it should, or did not go on."""
    parser = argparse.ArgumentParser("experiments.bench full-disk", description=__doc__)
    parser.add_argument("--sizes", nargs="+", type=int, default=[*SIZES], help="of the disks in kB; by default %(default)s")
    parser.add_argument("--random", type=int, default=0, help="so many random sizes more for each command")
    parser.add_argument("--seed", type=int, default=0, help="of the random sizes")
    parser.add_argument("--commands", nargs="+", help="these only, each as `train` or with its own sizes as `train:4,64`")
    options = parser.parse_args(arguments)
    if INSIDE not in os.environ:
        return enter(arguments)
    chance = random.Random(options.seed)
    return trials(_chosen(options.commands, [*options.sizes, *(chance.randint(4, 1024) for _ in range(options.random))]))


def enter(arguments: Sequence[str]) -> int:
    """Run this command in a namespace in which disks can be mounted.

    Raises:
        ConfigError: neither root nor a user may make one here.
    """
    for way in WAYS:
        if not subprocess.run([*way, "mount", "-t", "tmpfs", "tmpfs", "/mnt"], capture_output=True, check=False).returncode:
            again = [*way, sys.executable, "-m", "experiments.bench", "full-disk", *arguments]
            return subprocess.call(again, env={**os.environ, INSIDE: "1"})
    raise ConfigError("no small disk can be mounted here", remedy="run it as root, or allow namespaces of users")


def trials(sizes: dict[str, list[int]]) -> int:
    """Run the commands by name, each on its disks, and print what was found."""
    from experiments.bench.forks import warm_up  # noqa: PLC0415 - takes seconds
    from experiments.bench.full_disk.cases import CASES  # noqa: PLC0415
    from experiments.bench.full_disk.trial import Place, make_input  # noqa: PLC0415

    warm_up({*sizes, *(case.reads for case in CASES if case.name in sizes)})
    problems: list[str] = []
    rows = []
    with tempfile.TemporaryDirectory() as scratch:
        place = Place(Path(scratch))
        place.inputs.mkdir()
        chosen = [case for case in CASES if case.name in sizes]
        for name in {case.reads for case in chosen if case.reads}:
            make_input(next(case for case in CASES if case.name == name), place)
        rows = [_row(case, place, sizes[case.name], problems) for case in chosen]
    print(format_table(HEADER, rows))
    print("\n".join(problems), end="\n" if problems else "")
    return 1 if problems else 0


def _row(case: Case, place: Place, sizes: list[int], problems: list[str]) -> tuple[str, int, int, int]:
    from experiments.bench.full_disk.trial import trial, whole  # noqa: PLC0415 - takes seconds

    expected, full, bad, started = whole(case, place), 0, 0, time.monotonic()
    for size in sizes:
        small, wrong = trial(case, place, expected, size)
        full, bad = full + small, bad + bool(wrong)
        problems += [f"{case.name}, {size} kB: {what}" for what in wrong]
    print(f"{case.name}: {len(sizes)} disks, {bad} wrong, {time.monotonic() - started:.0f} s", file=sys.stderr)
    return case.name, len(sizes), full, bad


def _chosen(commands: Sequence[str] | None, sizes: list[int]) -> dict[str, list[int]]:
    """Sizes by command."""
    from experiments.bench.full_disk.cases import CASES  # noqa: PLC0415

    if commands is None:
        return {case.name: sizes for case in CASES}
    chosen = {}
    for text in commands:
        name, _, own = text.partition(":")
        chosen[name] = [int(size) for size in own.split(",")] if own else sizes
    return chosen
