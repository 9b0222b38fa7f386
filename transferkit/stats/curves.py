"""Measures of transfer from learning curves (Taylor & Stone 2009), on the axis of episodes or of environment steps.

A curve is evaluations `values` after `axis` units of experience, both `(points,)`, `axis` growing.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike

from transferkit.stats.intervals import CONFIDENCE, RESAMPLES

LAST = 0.1
"""Share of the budget whose evaluations make the asymptote."""


def jumpstart(values: ArrayLike, others: ArrayLike) -> float:
    """Compute the advantage before any training: the first evaluation minus that of the other curve."""
    return float(np.asarray(values, float)[0] - np.asarray(others, float)[0])


def area(axis: ArrayLike, values: ArrayLike) -> float:
    """Compute the mean height under the curve, by trapezia, between its first and its last point."""
    x, y = np.asarray(axis, float), np.asarray(values, float)
    return float(y[0]) if len(x) == 1 else float(np.trapezoid(y, x) / (x[-1] - x[0]))


def asymptote(axis: ArrayLike, values: ArrayLike) -> float:
    """Average the evaluations in the last tenth of the budget."""
    x, y = np.asarray(axis, float), np.asarray(values, float)
    return float(y[x >= x[-1] - LAST * (x[-1] - x[0])].mean())


def steps_to_threshold(axis: ArrayLike, values: ArrayLike, threshold: float) -> float:
    """Find the experience at the first evaluation that reaches the threshold; infinite for a curve that never does.

    A median over runs stays right with infinities in it, as long as fewer than half are: they are censored, not left out.
    """
    reached = np.flatnonzero(np.asarray(values, float) >= threshold)
    return float(np.asarray(axis, float)[reached[0]]) if len(reached) else float("inf")


def data_efficiency(scratch: ArrayLike, transfer: ArrayLike, *, source: float = 0.0) -> float:
    """Compute how many times as much experience scratch needs to the threshold, by medians; NaN if neither gets there.

    `source` is the experience that the core cost, for the total.
    """
    needed, by_scratch = float(np.median(np.asarray(transfer, float))) + source, float(np.median(np.asarray(scratch, float)))
    if needed == by_scratch:
        return float("nan") if np.isinf(needed) else 1.0
    return by_scratch / needed if needed else float("inf")  # there before any training


def data_efficiency_interval(scratch: ArrayLike, transfer: ArrayLike) -> tuple[float, float]:
    """Compute the bootstrap interval of `data_efficiency` over seeds.

    `scratch` is `(seeds,)`, `transfer` `(members, seeds)` of the same seeds, which are resampled together; members stay. A
    resample in which neither gets to the threshold says nothing and is left out; NaN if that is every one.
    """
    a, b = np.asarray(scratch, float), np.atleast_2d(np.asarray(transfer, float))
    rows = np.random.default_rng(0).integers(len(a), size=(RESAMPLES, len(a)))
    found = np.array([data_efficiency(a[row], b[:, row]) for row in rows])
    found = found[~np.isnan(found)]
    if not len(found):
        return float("nan"), float("nan")
    low, high = np.quantile(found, [(1 - CONFIDENCE) / 2, (1 + CONFIDENCE) / 2], method="inverted_cdf")  # between infinities
    return float(low), float(high)
