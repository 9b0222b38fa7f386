import numpy as np
import pytest
from scipy import stats as scipy_stats

from transferkit.stats import (
    holm_differences,
    iqm,
    paired_difference,
    performance_profile,
    probability_of_improvement,
    sign_flip_p,
    stratified_interval,
)

RNG = np.random.default_rng(0)
A, B = RNG.normal(1, 1, 12), RNG.normal(0, 1, 15)


def test_paired_differences_take_out_what_the_seeds_share():
    seeds = np.arange(10.0) * 100
    difference = paired_difference(seeds + np.linspace(0.9, 1.1, 10), seeds)
    assert difference.mean == pytest.approx(1.0)
    assert 0.9 < difference.low < 1 < difference.high < 1.1
    crossed = paired_difference(np.stack((seeds + 1, seeds + 3)), seeds)  # two members against one scratch run a seed
    assert crossed.mean == pytest.approx(2.0)
    assert crossed.n == 10
    with pytest.raises(ValueError, match="the same seeds"):
        paired_difference(seeds, seeds[:9])


def test_holm_widens_the_clearest_difference_most():
    scores = RNG.normal(10, 1, 20)
    controls = {"near": scores - RNG.normal(0.5, 1, 20), "far": scores - RNG.normal(9, 1, 20)}
    plain = {name: paired_difference(scores, other) for name, other in controls.items()}
    corrected = holm_differences(scores, controls)
    wider = {name: (corrected[name].high - corrected[name].low) / (plain[name].high - plain[name].low) for name in controls}
    assert list(corrected) == ["near", "far"]
    assert wider["far"] > 1.1  # 97.5 % in place of 95 %
    assert wider["near"] == pytest.approx(1, abs=0.05)
    # alone, nothing is corrected
    assert holm_differences(scores, {"far": controls["far"]})["far"] == plain["far"]


def test_holm_stops_at_the_first_that_is_not_clear():
    noise = np.array([1.0, -1.0, 0.4, -0.4, 0.2, -0.2, 1.4, -1.4])
    controls = {name: -0.8 - noise * scale for name, scale in (("a", 1.0), ("b", 1.001), ("c", 1.002))}
    assert all(paired_difference(np.zeros(8), other).low > 0 for other in controls.values())
    assert not any(difference.low > 0 for difference in holm_differences(np.zeros(8), controls).values())


def test_probability_of_improvement_is_the_mann_whitney_statistic():
    expected = scipy_stats.mannwhitneyu(A, B).statistic / (len(A) * len(B))
    assert probability_of_improvement(A, B) == pytest.approx(expected)
    assert probability_of_improvement([1.0, 1.0], [1.0]) == 0.5


def test_as_rliable():
    from rliable import library, metrics

    scores, others = RNG.normal(size=(10, 1)), RNG.normal(size=(10, 1))
    assert iqm(scores.ravel()) == pytest.approx(metrics.aggregate_iqm(scores))
    assert probability_of_improvement(scores, others) == pytest.approx(metrics.probability_of_improvement(scores, others))
    thresholds = np.linspace(-1, 1, 5)
    profile = [library.run_score_deviation(scores, threshold) for threshold in thresholds]
    np.testing.assert_allclose(performance_profile(scores, thresholds), profile)
    mean, interval = library.get_interval_estimates({"a": scores}, lambda x: np.array([metrics.aggregate_mean(x)]), reps=2000)
    assert mean["a"][0] == pytest.approx(scores.mean())
    low, high = stratified_interval(scores, np.mean)
    width = interval["a"][1, 0] - interval["a"][0, 0]  # rliable's percentiles, not moved outwards for ten runs
    assert width < high - low < 1.4 * width


def test_sign_flips_are_counted():
    assert sign_flip_p([1, 2, 3, 4, 5]) == 1 / 32
    assert sign_flip_p([1, -1]) == 3 / 4
    assert sign_flip_p([3, 2, -1]) == 2 / 8  # of sums 6, 4, 2, 0, 0, -2, -4, -6 two are at least 4
    assert sign_flip_p([-1, -2]) == 1.0
    assert (sign_flip_p([0.5]), sign_flip_p([0.0])) == (0.5, 1.0)
