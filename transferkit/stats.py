"""Statistics of returns: pure functions on arrays."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import Any

import numpy as np
from scipy import stats as scipy_stats

CONFIDENCE = 0.95
RESAMPLES = 2000


def iqm(values: Sequence[float]) -> float:
    """Interquartile mean: the mean without the lowest and the highest quarter (Agarwal et al. 2021)."""
    return float(scipy_stats.trim_mean(values, 0.25))


def iqm_interval(values: Sequence[float], *, seed: int = 0) -> tuple[float, float]:
    """Percentile bootstrap 95 % interval of the interquartile mean over runs."""
    return _interval(values, lambda x, axis: scipy_stats.trim_mean(x, 0.25, axis=axis), seed)


def mean_interval(values: Sequence[float], *, seed: int = 0) -> tuple[float, float]:
    """Percentile bootstrap 95 % interval of the mean of independent values (Efron 1979).

    One value, or equal values, give an interval of no width: the sample says nothing about its spread.
    """
    return _interval(values, np.mean, seed)


def _interval(values: Sequence[float], statistic: Callable[..., Any], seed: int) -> tuple[float, float]:
    sample = np.asarray(values, float)
    if np.ptp(sample) == 0:
        return float(sample[0]), float(sample[0])
    interval = scipy_stats.bootstrap(
        (sample,),
        statistic,
        n_resamples=RESAMPLES,
        confidence_level=CONFIDENCE,
        method="percentile",
        rng=np.random.default_rng(seed),
    ).confidence_interval
    return float(interval.low), float(interval.high)


def hierarchical_interval(groups: Sequence[Sequence[float]], *, seed: int = 0) -> tuple[float, float]:
    """Bootstrap 95 % interval of the mean over groups that are themselves a sample (source seeds of a core).

    Groups are resampled first, then the values within each (Davison & Hinkley 1997, 3.8); groups are of equal size.
    """
    values = np.asarray(groups, float)
    members, episodes = values.shape
    rng = np.random.default_rng(seed)
    rows = rng.integers(members, size=(RESAMPLES, members, 1))
    columns = rng.integers(episodes, size=(RESAMPLES, members, episodes))
    means = values[rows, columns].mean(axis=(1, 2))
    low, high = np.quantile(means, [(1 - CONFIDENCE) / 2, (1 + CONFIDENCE) / 2])
    return float(low), float(high)
