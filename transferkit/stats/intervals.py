"""Aggregates and their intervals: Student's for means, the bootstrap's for interquartile means.

The percentiles of a bootstrap cannot leave the range of the sample, which makes them too narrow for a mean of few runs.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray
from scipy.special import ndtr, stdtrit

CONFIDENCE = 0.95
RESAMPLES = 2000

Statistic = Callable[..., Any]
"""A function of an array along `axis`."""


def iqm(values: ArrayLike, axis: int | None = None) -> Any:  # noqa: ANN401 - a number, or an array along the other axes
    """Interquartile mean: the mean without the lowest and the highest quarter (Agarwal et al. 2021)."""
    from scipy.stats import trim_mean  # noqa: PLC0415 - takes half a second to import

    mean = trim_mean(np.asarray(values, float), 0.25, axis=axis)  # type: ignore[arg-type] - None is allowed
    return float(mean) if np.ndim(mean) == 0 else mean


def normalized(scores: ArrayLike, low: float, high: float) -> NDArray[np.float64]:
    """Put scores on a scale on which `low` is 0 and `high` is 1.

    Raises:
        ValueError: both references are equal.
    """
    if high == low:
        raise ValueError(f"the references of a normalised score are both {low:g}")
    return (np.asarray(scores, float) - low) / (high - low)


def mean_interval(values: ArrayLike) -> tuple[float, float]:
    """Compute Student's interval of the mean of independent values.

    One value, or equal values, give an interval of no width: the sample says nothing about its spread.
    """
    return crossed_interval(np.asarray(values, float)[None])


def summary_interval(mean: float, deviation: float, n: int) -> tuple[float, float]:
    """Student's interval of a mean from its summary: the mean, the standard deviation (n - 1) and the count of the values."""
    if n < 2 or not deviation:
        return mean, mean
    return _student(mean, deviation / np.sqrt(n), n - 1, CONFIDENCE)


def iqm_interval(values: ArrayLike) -> tuple[float, float]:
    """Compute the bootstrap interval of the interquartile mean of independent runs."""
    return stratified_interval(np.asarray(values, float)[:, None], iqm)


def stratified_interval(scores: ArrayLike, statistic: Statistic) -> tuple[float, float]:
    """Compute the interval of a statistic of scores `(runs, tasks)`, the runs of each task resampled (Agarwal et al. 2021)."""
    values = np.asarray(scores, float)
    runs, tasks = values.shape
    rows = np.random.default_rng(0).integers(runs, size=(RESAMPLES, runs, tasks))
    resampled = values[rows, np.arange(tasks)]
    low, high = _percentiles(statistic(resampled.reshape(RESAMPLES, -1), axis=1), runs, tasks * (runs - 1))
    return float(low), float(high)


def hierarchical_interval(groups: ArrayLike) -> tuple[float, float]:
    """Compute the interval of the mean over groups `(groups, values)` that are themselves a sample, as source seeds are.

    The groups' means are the sample: their spread holds that within them (Davison & Hinkley 1997, 3.8). Of one group it is the
    interval over its values.
    """
    values = np.asarray(groups, float)
    return mean_interval(values[0] if len(values) == 1 else values.mean(axis=1))


def crossed_interval(scores: ArrayLike, *, confidence: float = CONFIDENCE) -> tuple[float, float]:
    """Compute the interval of the mean of scores `(members, seeds)`, every member run with every seed, both a sample.

    The variances of the means over members and over seeds are added, which counts noise of single runs twice if there are
    several of both (Owen 2007), with the degrees of freedom of such a sum (Satterthwaite 1946).
    """
    values = np.asarray(scores, float)
    mean = float(values.mean())
    factors = [means for means in (values.mean(axis=1), values.mean(axis=0)) if len(means) > 1 and np.ptp(means)]
    if not factors:
        return mean, mean
    unit = float(max(map(np.ptp, factors)))  # squares of what is very small are 0
    variances = [float((means / unit).var(ddof=1)) / len(means) for means in factors]
    freedom = sum(variances) ** 2 / sum(v**2 / (len(means) - 1) for v, means in zip(variances, factors, strict=True))
    return _student(mean, unit * float(np.sqrt(sum(variances))), freedom, confidence)


def crossed_band(
    curves: ArrayLike, statistic: Statistic, *, resamples: int = RESAMPLES
) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Compute the intervals of a statistic at every point of curves `(members, seeds, points)`, both resampled (Owen 2007)."""
    values = np.asarray(curves, float)
    members, seeds, points = values.shape
    generator = np.random.default_rng(0)
    rows = generator.integers(members, size=(resamples, members, 1))
    columns = generator.integers(seeds, size=(resamples, 1, seeds))
    resampled = statistic(values[rows, columns].reshape(resamples, members * seeds, points), axis=1)
    fewest = min((size for size in (members, seeds) if size > 1), default=1)
    return _percentiles(resampled, fewest, fewest - 1)


def _student(mean: float, error: float, freedom: float, confidence: float) -> tuple[float, float]:
    """Student's interval of a mean with this standard error."""
    half = float(stdtrit(freedom, (1 + confidence) / 2)) * error
    return mean - half, mean + half


def _percentiles(resampled: NDArray[np.float64], n: int, freedom: int) -> Any:  # noqa: ANN401
    """Compute both ends of statistics `(resamples, ...)`, moved outwards for small samples of `n` (Hesterberg 2015, 4.2)."""
    tail = (1 - CONFIDENCE) / 2
    if freedom > 0:
        tail = float(ndtr(np.sqrt(n / (n - 1)) * stdtrit(freedom, tail)))
    return np.quantile(resampled, [tail, 1 - tail], axis=0)
