import numpy as np
import pytest

from transferkit.stats import hierarchical_interval, iqm, iqm_interval, mean_interval


def test_the_interval_of_a_mean_is_close_to_the_normal_one_and_repeatable():
    sample = np.random.default_rng(0).normal(5, 2, 400)
    low, high = mean_interval(sample)
    half = 1.96 * sample.std(ddof=1) / 20
    assert (low, high) == pytest.approx((sample.mean() - half, sample.mean() + half), abs=0.03)
    assert mean_interval(sample) == (low, high)
    assert mean_interval([7.0, 7.0]) == (7.0, 7.0)


def test_interquartile_mean():
    values = [0.0, 1.0, 2.0, 3.0, 4.0, 5.0, 6.0, 100.0]
    assert iqm(values) == pytest.approx((2 + 3 + 4 + 5) / 4)
    low, high = iqm_interval(values)
    assert 0 < low < 3.5 < high < 60


def test_members_count_as_the_sample_not_episodes():
    """Five members that differ and hardly vary inside: the interval is that of five values, not of a hundred."""
    groups = [np.full(20, mean) + np.linspace(-0.01, 0.01, 20) for mean in (0.0, 10.0, 20.0, 30.0, 40.0)]
    low, high = hierarchical_interval(groups)
    deviation = np.std([0, 10, 20, 30, 40]) / np.sqrt(5)
    assert (high - low) / 2 == pytest.approx(1.96 * deviation, rel=0.1)
