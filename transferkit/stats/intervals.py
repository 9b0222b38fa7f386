"""Aggregates and their bootstrap intervals."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray
from scipy import stats as scipy_stats

CONFIDENCE = 0.95
RESAMPLES = 2000

Statistic = Callable[..., Any]
"""Of an array along `axis`."""


def iqm(values: ArrayLike, axis: int | None = None) -> Any:  # noqa: ANN401 - a number, or an array along the other axes
    """Interquartile mean: the mean without the lowest and the highest quarter (Agarwal et al. 2021)."""
    mean = scipy_stats.trim_mean(np.asarray(values, float), 0.25, axis=axis)  # type: ignore[arg-type] - None is allowed
    return float(mean) if np.ndim(mean) == 0 else mean


def normalized(scores: ArrayLike, low: float, high: float) -> NDArray[np.float64]:
    """Scores on a scale on which `low` is 0 and `high` is 1.

    Raises:
        ValueError: both references are equal.
    """
    if high == low:
        raise ValueError(f"the references of a normalised score are both {low:g}")
    return (np.asarray(scores, float) - low) / (high - low)


def mean_interval(
    values: ArrayLike, *, rng: np.random.Generator | None = None, confidence: float = CONFIDENCE
) -> tuple[float, float]:
    """Bootstrap interval of the mean of independent values.

    One value, or equal values, give an interval of no width: the sample says nothing about its spread.
    """
    return stratified_interval(np.asarray(values, float)[:, None], np.mean, rng=rng, confidence=confidence)


def iqm_interval(
    values: ArrayLike, *, rng: np.random.Generator | None = None, confidence: float = CONFIDENCE
) -> tuple[float, float]:
    """Bootstrap interval of the interquartile mean of independent runs."""
    return stratified_interval(np.asarray(values, float)[:, None], iqm, rng=rng, confidence=confidence)


def stratified_interval(
    scores: ArrayLike,
    statistic: Statistic,
    *,
    rng: np.random.Generator | None = None,
    confidence: float = CONFIDENCE,
) -> tuple[float, float]:
    """Interval of a statistic of all scores `(runs, tasks)`, the runs of each task resampled (Agarwal et al. 2021)."""
    values = np.asarray(scores, float)
    runs, tasks = values.shape
    rows = generator_or_fixed(rng).integers(runs, size=(RESAMPLES, runs, tasks))
    resampled = values[rows, np.arange(tasks)]
    return _expanded(statistic(resampled.reshape(RESAMPLES, -1), axis=1), runs, tasks * (runs - 1), confidence)


def hierarchical_interval(
    groups: ArrayLike, *, rng: np.random.Generator | None = None, confidence: float = CONFIDENCE
) -> tuple[float, float]:
    """Interval of the mean over groups `(groups, values)` that are themselves a sample, as the source seeds of a core.

    Groups are resampled whole (Davison & Hinkley 1997, 3.8: resampling within them too would count their spread twice).
    """
    return mean_interval(np.asarray(groups, float).mean(axis=1), rng=rng, confidence=confidence)


def crossed_interval(
    scores: ArrayLike, *, rng: np.random.Generator | None = None, confidence: float = CONFIDENCE
) -> tuple[float, float]:
    """Interval of the mean of scores `(members, seeds)`, every member run with every seed, both a sample.

    Members and seeds are resampled independently (Owen 2007). That is conservative where neither matters.
    """
    values = np.asarray(scores, float)
    members, seeds = values.shape
    generator = generator_or_fixed(rng)
    rows = generator.integers(members, size=(RESAMPLES, members, 1))
    columns = generator.integers(seeds, size=(RESAMPLES, 1, seeds))
    freedom = _freedom(values.mean(axis=1), values.mean(axis=0))
    return _expanded(values[rows, columns].mean(axis=(1, 2)), freedom + 1, freedom, confidence)


def generator_or_fixed(rng: np.random.Generator | None) -> np.random.Generator:
    """The caller's generator, or one that always gives the same."""
    return np.random.default_rng(0) if rng is None else rng


def _freedom(*factors: NDArray[np.float64]) -> float:
    """Degrees of freedom of a mean whose variance is the sum of its factors' (Satterthwaite 1946)."""
    sizes = [len(means) for means in factors if len(means) > 1]
    variances = [means.var(ddof=1) / len(means) for means in factors if len(means) > 1]
    if not sum(variances):
        return float(sum(size - 1 for size in sizes))
    return sum(variances) ** 2 / sum(v**2 / (n - 1) for v, n in zip(variances, sizes, strict=True))


def _expanded(statistics: NDArray[np.float64], n: float, freedom: float, confidence: float) -> tuple[float, float]:
    """Percentiles of bootstrapped statistics, moved outwards for small samples of `n` (Hesterberg 2015, 4.2)."""
    tail = (1 - confidence) / 2
    if freedom > 0:
        tail = float(scipy_stats.norm.cdf(np.sqrt(n / (n - 1)) * scipy_stats.t.ppf(tail, freedom)))
    low, high = np.quantile(statistics, [tail, 1 - tail])
    return float(low), float(high)
