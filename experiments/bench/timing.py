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
