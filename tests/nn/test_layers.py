import torch

from transferkit.nn import Linear, ResidualLinear, one_thread
from transferkit.streams import Streams


def test_residual_layers_start_as_the_identity():
    x = torch.randn(3, 4, generator=Streams(0).torch("x"))
    assert torch.equal(ResidualLinear(4)(x), x)


def test_initial_weights_do_not_depend_on_the_number_of_threads():
    weights = []
    for threads in (2, 1):
        torch.set_num_threads(threads)
        weights.append(Linear(64, 64, Streams(0).torch("layer"), gain=1.0).weight)
        assert torch.get_num_threads() == threads
    assert torch.equal(*weights)


def test_one_thread_gives_the_callers_number_back():
    torch.set_num_threads(2)
    try:
        with one_thread():
            assert torch.get_num_threads() == 1
        assert torch.get_num_threads() == 2
    finally:
        torch.set_num_threads(1)


def test_a_layer_without_a_generator_waits_for_its_weights():
    assert not any(parameter.any() for parameter in Linear(3, 2).parameters())


def test_a_layer_draws_orthogonal_weights_or_those_of_torch():
    orthogonal, biased, uniform = (
        Linear(4, 3, Streams(0).torch("x"), **how) for how in ({"gain": 2.0}, {"gain": 2.0, "zero_bias": False}, {})
    )
    torch.testing.assert_close(orthogonal.weight @ orthogonal.weight.T, 4 * torch.eye(3))
    assert torch.equal(orthogonal.weight, biased.weight)
    assert not orthogonal.bias.any()
    for layer in (biased, uniform):
        assert 0 < layer.bias.abs().max() <= 0.5  # 1 / sqrt(4)
    assert uniform.weight.abs().max() <= 0.5
