import numpy as np
import pytest
from scipy import stats as scipy_stats

from transferkit.stats import (
    crossed_band,
    crossed_interval,
    hierarchical_interval,
    iqm,
    iqm_interval,
    mean_interval,
    normalized,
    stratified_interval,
    summary_interval,
)


def test_the_interval_of_a_mean_is_students():
    sample = np.array([1.0, 2.0, 4.0, 5.0, 9.0])
    expected = scipy_stats.ttest_1samp(sample, 0).confidence_interval(0.95)
    assert mean_interval(sample) == pytest.approx((expected.low, expected.high))
    assert mean_interval([7.0, 7.0]) == (7.0, 7.0)
    assert mean_interval([7.0]) == (7.0, 7.0)
    assert summary_interval(sample.mean(), sample.std(ddof=1), len(sample)) == pytest.approx((expected.low, expected.high))
    assert summary_interval(7.0, 0.0, 2) == summary_interval(7.0, 3.0, 1) == (7.0, 7.0)


def test_a_bootstrap_is_repeatable_and_close_to_the_normal_interval_of_many():
    sample = np.random.default_rng(0).normal(5, 2, 400)
    low, high = stratified_interval(sample[:, None], np.mean)
    half = 1.96 * sample.std(ddof=1) / 20
    assert (low, high) == pytest.approx((sample.mean() - half, sample.mean() + half), abs=0.03)
    assert stratified_interval(sample[:, None], np.mean) == (low, high)


def test_interquartile_mean():
    values = [0.0, 1.0, 2.0, 3.0, 4.0, 5.0, 6.0, 100.0]
    assert iqm(values) == pytest.approx((2 + 3 + 4 + 5) / 4)
    low, high = iqm_interval(values)
    assert 0 < low < 3.5 < high < 100


def test_members_count_as_the_sample_not_episodes():
    """Members that differ and hardly vary inside: the interval is that of five values, not of a hundred."""
    means = np.array([0.0, 10.0, 20.0, 30.0, 40.0])
    groups = means[:, None] + np.linspace(-0.01, 0.01, 20)
    assert hierarchical_interval(groups) == pytest.approx(mean_interval(means))
    assert hierarchical_interval(groups[:1]) == mean_interval(groups[0])  # of one member all that is known


def test_crossed_factors_both_count():
    rng = np.random.default_rng(0)
    by_member, by_seed = rng.normal(size=(8, 1)) @ np.ones((1, 8)), np.ones((8, 1)) @ rng.normal(size=(1, 8))
    for scores in (by_member, by_seed):
        low, high = crossed_interval(scores)
        assert (low, high) == pytest.approx(mean_interval(np.unique(scores.round(12))))
    assert crossed_interval([[1.0, 2.0, 3.0]])[0] < 2 < crossed_interval([[1.0, 2.0, 3.0]])[1]


def test_normalised_scores():
    assert normalized([87.0, 9360.0], 87.0, 9360.0).tolist() == [0.0, 1.0]
    with pytest.raises(ValueError, match="both 5"):
        normalized([1.0], 5.0, 5.0)


def coverage(interval, draw, truth=0.0, samples=500):
    """Share of the intervals with the truth in them; its standard error is 1 %."""
    rng = np.random.default_rng(0)
    covered = []
    for _ in range(samples):
        low, high = interval(draw(rng))
        covered.append(low <= truth <= high)
    return np.mean(covered)


NORMAL = [
    (mean_interval, lambda rng: rng.normal(size=3)),
    (mean_interval, lambda rng: rng.normal(size=10)),
    (iqm_interval, lambda rng: rng.normal(size=5)),
    (iqm_interval, lambda rng: rng.normal(size=20)),
    (lambda x: stratified_interval(x, iqm), lambda rng: rng.normal(size=(10, 3))),
    (hierarchical_interval, lambda rng: rng.normal(size=(5, 1)) + rng.normal(size=(5, 20))),
    # five members, ten seeds, all sources of spread alike; then members alone
    (crossed_interval, lambda rng: rng.normal(size=(5, 1)) + rng.normal(size=(1, 10)) + rng.normal(size=(5, 10))),
    (crossed_interval, lambda rng: rng.normal(size=(5, 1)) + 0.3 * rng.normal(size=(5, 10))),
    (lambda x: [end[0] for end in crossed_band(x[..., None], np.mean)], lambda rng: rng.normal(size=(1, 10))),
]


@pytest.mark.parametrize("case", range(len(NORMAL)))
def test_intervals_of_95_percent_cover_the_truth_so_often(case):
    assert 0.92 <= coverage(*NORMAL[case]) <= 0.975


@pytest.mark.parametrize("scale", [1e-120, 1.0, 1e120])
def test_an_interval_scales_with_its_values(scale):
    values = np.array([[1.0, 2.0, 4.0], [2.0, 3.0, 7.0]])
    np.testing.assert_allclose(np.array(crossed_interval(values * scale)) / scale, crossed_interval(values))
