import numpy as np

from experiments.report.curves import running_mean


def test_running_mean_is_of_what_is_there():
    np.testing.assert_allclose(running_mean(np.array([1.0, 3.0, 5.0, 7.0]), 2), [1.0, 2.0, 4.0, 6.0])
    assert running_mean(np.array([1e20, 3.0, 5.0]), 2)[-1] == 4.0
