"""What commands print: a table or one JSON object, and progress on stderr."""

from __future__ import annotations

import json
import sys
import time
from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from pathlib import Path
from typing import TYPE_CHECKING, Any

from transferkit.budget import Budget, Spent
from transferkit.errors import ConfigError

if TYPE_CHECKING:
    from transferkit.run.session import Report

PLAIN_SECONDS = 15.0
"""Between progress lines where stderr is no terminal."""


def print_json(data: Any) -> None:  # noqa: ANN401 - any JSON value
    """One JSON value on stdout."""
    print(json.dumps(data, indent=2, allow_nan=False))


def check_new(path: Path, flag: str) -> None:
    """Refuse a file that exists, or whose folder does not, before any work is done for it.

    Raises:
        ConfigError: so.
    """
    if path.exists():
        raise ConfigError(f"{path} exists; pass another {flag}")
    if not path.parent.is_dir():
        raise ConfigError(f"cannot write {path}: no folder {path.parent}; pass {flag} in a folder that exists")


@contextmanager
def progress(label: str, budget: Budget) -> Iterator[Report]:
    """A progress bar with the time left, as a `Report`."""
    if not sys.stderr.isatty():
        yield _plain(label, budget)
        return
    from rich.console import Console  # noqa: PLC0415 - a tenth of a second
    from rich.progress import BarColumn, Progress, TextColumn, TimeElapsedColumn, TimeRemainingColumn  # noqa: PLC0415

    columns = (
        TextColumn("{task.description}"),
        BarColumn(bar_width=24),
        TextColumn("{task.percentage:>3.0f} %"),
        TimeElapsedColumn(),
        TextColumn("left"),
        TimeRemainingColumn(),
        TextColumn("{task.fields[text]}"),
    )
    with Progress(*columns, console=Console(stderr=True)) as bar:
        task = bar.add_task(label, total=1.0, text="")

        def report(spent: Spent, metrics: Mapping[str, float]) -> None:
            bar.update(task, completed=min(1.0, spent.fraction(budget)), text=_text(spent, metrics))

        yield report


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
