"""Times of calls, and how they are printed."""

from __future__ import annotations

import statistics
import time
from collections.abc import Callable, Iterable


def seconds(function: Callable[[], object]) -> float:
    """Time one call."""
    started = time.perf_counter()
    function()
    return time.perf_counter() - started


def spread(values: Iterable[float], digits: int = 2) -> str:
    """Median and range."""
    found = [*values]
    low, middle, high = (f"{value:.{digits}f}" for value in (min(found), statistics.median(found), max(found)))
    return f"{middle} ({low} to {high})"


def compare(title: str, calls: dict[str, Callable[[], object]], rounds: int) -> None:
    """Time the calls in turns and print each one's ratio to the first."""
    for call in calls.values():
        call()
    times = [{name: seconds(call) for name, call in calls.items()} for _ in range(rounds)]
    base = next(iter(calls))
    print(title)
    for name in calls:
        ratios = sorted(one[name] / one[base] for one in times)
        milliseconds = 1e3 * statistics.median(one[name] for one in times)
        low, high = ratios[len(ratios) // 10], ratios[-1 - len(ratios) // 10]
        print(f"  {name}: {milliseconds:.1f} ms, {statistics.median(ratios):.2f} times ours ({low:.2f} to {high:.2f})")
