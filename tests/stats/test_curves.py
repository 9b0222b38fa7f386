import numpy as np
import pytest

from transferkit.stats import area, asymptote, data_efficiency, data_efficiency_interval, jumpstart, steps_to_threshold


def test_curves():
    axis, values, others = [0, 100, 200, 1000], [10.0, 20.0, 30.0, 30.0], [5.0, 5.0, 5.0, 40.0]
    assert jumpstart(values, others) == 5
    assert area(axis, values) == pytest.approx((15 * 100 + 25 * 100 + 30 * 800) / 1000)
    assert area([0], [3.0]) == 3
    assert asymptote([0, 500, 900, 1000], [0.0, 1.0, 2.0, 4.0]) == 3
    assert steps_to_threshold(axis, values, 25) == 200
    assert steps_to_threshold(axis, values, 31) == float("inf")


def test_the_interval_of_data_efficiency_is_over_seeds():
    inf = float("inf")
    assert data_efficiency_interval([400, 400, 400], [[100, 100, 100], [200, 200, 200]]) == pytest.approx(
        (400 / 150, 400 / 150)
    )
    low, high = data_efficiency_interval([200, 400, 800, inf], [[100, 100, 100, 100]])
    assert low == 2
    assert high == inf
    assert np.isnan(data_efficiency_interval([inf, inf], [[inf, inf]])).all()


def test_data_efficiency_keeps_runs_that_never_get_there():
    inf = float("inf")
    assert data_efficiency([400, 600, inf], [100, 200, inf]) == 3
    assert data_efficiency([400, 600, inf], [100, 200, inf], source=400) == 1
    assert data_efficiency([inf, inf, 1], [5, 5, 5]) == inf
    assert data_efficiency([5, 5], [0, 0]) == inf
    assert data_efficiency([0, 0], [0, 0]) == 1
    assert np.isnan(data_efficiency([inf], [inf]))
