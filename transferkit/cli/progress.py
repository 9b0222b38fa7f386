"""Progress of training on stderr: a bar in a terminal, a line now and then elsewhere."""

from __future__ import annotations

import sys
import time
from collections.abc import Callable, Iterator, Mapping
from contextlib import contextmanager
from typing import TYPE_CHECKING

from rich.console import Console
from rich.progress import BarColumn, Progress, TextColumn, TimeElapsedColumn, TimeRemainingColumn

if TYPE_CHECKING:
    from transferkit.budget import Budget, Spent
    from transferkit.run import Report

EVALUATION_SECONDS = 5.0
"""Least time between lines about an evaluation."""

PLAIN_SECONDS = 15.0
"""Least time between progress lines if stderr is not a terminal."""

COLUMNS = (
    TextColumn("{task.description}"),
    BarColumn(bar_width=24),
    TextColumn("{task.percentage:>3.0f} %"),
    TimeElapsedColumn(),
    TextColumn("left"),
    TimeRemainingColumn(),
    TextColumn("{task.fields[text]}"),
)


@contextmanager
def progress(label: str, budget: Budget) -> Iterator[Report]:
    """Show progress with the time left, through a `Report`."""
    if not sys.stderr.isatty():
        yield _plain(label, budget)
        return
    with Progress(*COLUMNS, console=Console(stderr=True)) as bar:
        task = bar.add_task(label, total=1.0, text="")

        def report(spent: Spent, metrics: Mapping[str, float]) -> None:
            bar.update(task, completed=min(1.0, spent.fraction(budget)), text=_text(spent, metrics))

        yield report


def evaluation_progress(episodes: int) -> Callable[[int, int], None]:
    """A report of an evaluation that says now and then how far it is, on a line."""
    started = last = time.monotonic()

    def report(ended: int, steps: int) -> None:
        nonlocal last
        now = time.monotonic()
        if now - last >= EVALUATION_SECONDS:
            last = now
            left = f"{(now - started) * (episodes - ended) / ended:.0f} s left, " if ended else ""
            print(f"evaluation: {ended} of {episodes} episodes, {left}{steps} steps", file=sys.stderr, flush=True)

    return report


def counting_progress(things: str) -> Callable[[int, int], None]:
    """A report of how many of several things are done, such as `cores played`, on a line now and then."""
    started = last = time.monotonic()

    def report(done: int, total: int) -> None:
        nonlocal last
        now = time.monotonic()
        if now - last >= EVALUATION_SECONDS and done < total:
            last = now
            left = (now - started) * (total - done) / done
            print(f"{done:,} of {total:,} {things}, {left:.0f} s left", file=sys.stderr, flush=True)

    return report


def _plain(label: str, budget: Budget) -> Report:
    last = time.monotonic()

    def report(spent: Spent, metrics: Mapping[str, float]) -> None:
        nonlocal last
        now, share = time.monotonic(), min(1.0, spent.fraction(budget))
        if now - last >= PLAIN_SECONDS and share > 0:
            last = now
            left = spent.seconds * (1 - share) / share
            print(f"{label}: {share:.0%}, {left:.0f} s left, {_text(spent, metrics)}", file=sys.stderr)

    return report


def _text(spent: Spent, metrics: Mapping[str, float]) -> str:
    recent = metrics.get("recent_return")
    tail = "" if recent is None else f", return {recent:.1f} (last 50)"
    return f"{spent.episodes} episodes, {spent.steps} steps{tail}"
