"""One arm against another."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike, NDArray

from transferkit.stats.intervals import CONFIDENCE, crossed_interval


@dataclass(frozen=True)
class Difference:
    """Mean of paired differences, with its interval."""

    mean: float
    low: float
    high: float
    n: int
    """Seeds."""


def paired_difference(scores: ArrayLike, others: ArrayLike, *, confidence: float = CONFIDENCE) -> Difference:
    """Average `scores - others` over runs that share their seed.

    Either is `(members, seeds)`, or `(seeds,)` for an arm without a core, which is then the partner of every member.

    Raises:
        ValueError: they do not have the same seeds.
    """
    a, b = np.atleast_2d(np.asarray(scores, float)), np.atleast_2d(np.asarray(others, float))
    if a.shape[1] != b.shape[1]:
        raise ValueError(f"paired arms need the same seeds; these have {a.shape[1]} and {b.shape[1]}")
    difference = a - b
    low, high = crossed_interval(difference, confidence=confidence)
    return Difference(float(difference.mean()), low, high, difference.shape[1])


def sign_flip_p(differences: ArrayLike) -> float:
    """Test whether paired differences are above zero: the share of all ways to flip their signs that have a mean as large.

    Exact up to 13 pairs, of random flips beyond (Fisher 1935; `scipy.stats.permutation_test`).
    """
    from scipy.stats import permutation_test  # noqa: PLC0415 - takes half a second to import

    values = np.asarray(differences, float)
    if values.size == 1:  # which scipy refuses
        return 0.5 if values[0] > 0 else 1.0
    test = permutation_test((values,), np.mean, permutation_type="samples", alternative="greater", rng=0)
    return float(test.pvalue)


def holm_differences(scores: ArrayLike, controls: Mapping[str, ArrayLike]) -> dict[str, Difference]:
    """Compare with several controls; intervals exclude 0 if Holm's step-down test rejects (Holm 1979).

    The clearest of m differences gets the confidence 1 - 0.05 / m, the next 1 - 0.05 / (m - 1), and so on to the first whose
    interval includes 0; the level stays there. The rejections hold together; the intervals as such do not.
    """
    plain = {name: paired_difference(scores, other) for name, other in controls.items()}
    left, corrected = len(plain), {}
    for name in sorted(plain, key=lambda name: _clearness(plain[name]), reverse=True):
        difference = paired_difference(scores, controls[name], confidence=1 - (1 - CONFIDENCE) / left)
        left -= difference.low > 0 or difference.high < 0
        corrected[name] = difference
    return {name: corrected[name] for name in controls}


def probability_of_improvement(scores: ArrayLike, others: ArrayLike) -> float:
    """Estimate the probability that a run of the first arm beats one of the second on one task, ties counted half.

    The Mann-Whitney statistic over the number of pairs (Agarwal et al. 2021).
    """
    a, b = (np.asarray(values, float).ravel() for values in (scores, others))
    return float(np.mean((a[:, None] > b) + 0.5 * (a[:, None] == b)))


def performance_profile(scores: ArrayLike, thresholds: ArrayLike) -> NDArray[np.float64]:
    """Compute the share of the runs above each threshold (Agarwal et al. 2021; Dolan & More 2002), `(thresholds,)`."""
    return (np.asarray(scores, float).ravel()[None] > np.asarray(thresholds, float)[:, None]).mean(axis=1)


def _clearness(difference: Difference) -> float:
    width = difference.high - difference.low
    return abs(difference.mean) / width if width else np.inf
