import numpy as np
import torch

from transferkit.nn import Normalizer


def test_the_normaliser_equals_numpy_over_batches():
    data = np.random.default_rng(0).normal(3, 2, (300, 3)).astype(np.float32)
    normalizer = Normalizer(3)
    for start, stop in ((0, 10), (10, 250), (250, 300)):
        normalizer.update(torch.from_numpy(data[start:stop]))
    np.testing.assert_allclose(normalizer.mean, data.mean(0), rtol=1e-4)
    np.testing.assert_allclose(normalizer.var, data.var(0), rtol=1e-4)
    assert normalizer.count == 300
    outputs = normalizer(torch.tensor([[1e6, 3.0, -1e6]]))
    assert outputs[0, 0] == 10 and outputs[0, 2] == -10  # noqa: PT018
