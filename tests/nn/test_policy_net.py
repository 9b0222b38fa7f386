import pytest
import torch

from transferkit.nn import Architecture, PolicyNet
from transferkit.reading import typed
from transferkit.streams import Streams


def test_initialisation_leaves_the_global_generator_alone():
    torch.manual_seed(0)
    before = torch.get_rng_state()
    PolicyNet(Architecture(4, 2, std="head"), Streams(0).torch("a"))
    PolicyNet(Architecture(4, 2), Streams(0).torch("a"))
    assert torch.equal(before, torch.get_rng_state())


def test_the_paper_parameter_counts():
    """PPO 18,050 on InvertedDoublePendulum-v5: two heads on 128-128."""
    network = PolicyNet(Architecture(9, 1, (128, 128), "relu", "head"))
    assert sum(p.numel() for p in network.parameters()) == 18_050


def test_the_papers_network_begins_as_in_its_code():
    """Orthogonal with gains sqrt(2) and 0.1, and biases as `nn.Linear` draws them."""
    network = PolicyNet(Architecture(4, 1, (128, 128), "relu", "head", "paper"), Streams(0).torch("a"))
    first, second = network.body[0], network.body[2]
    assert torch.allclose(first.weight.T @ first.weight, 2 * torch.eye(4), atol=1e-5)
    assert torch.allclose(second.weight.T @ second.weight, 2 * torch.eye(128), atol=1e-5)
    for head in (network.mean_head, network.log_std_head):
        assert float(head.weight.norm()) == pytest.approx(0.1)
    for layer, bound in ((first, 4**-0.5), (second, 128**-0.5), (network.mean_head, 128**-0.5)):
        assert 0 < float(layer.bias.abs().max()) <= bound


def test_how_a_log_std_is_made_does_not_say_how_it_begins():
    """A head with the usual initialisation is small, and so is the whole policy's first step."""
    network = PolicyNet(Architecture(4, 1, std="head"), Streams(0).torch("a"))
    assert float(network.log_std_head.weight.norm()) == pytest.approx(0.01)
    assert float(network.body[0].bias.abs().max()) == 0.0


@pytest.mark.parametrize("std", ["parameter", "head"])
@pytest.mark.parametrize("squash", [False, True])
def test_a_network_is_rebuilt_from_its_architecture(std, squash):
    architecture = Architecture(3, 2, (8, 4), "elu", std, "uniform", squash)
    network = PolicyNet(architecture, Streams(0).torch("a"))
    twin = PolicyNet(typed(architecture.to_json(), Architecture))
    twin.load_state_dict(network.state_dict())
    x = 100 * torch.randn(5, 3, generator=Streams(0).torch("x"))
    for a, b in zip(network(x), twin(x), strict=True):
        assert torch.equal(a, b)
    assert (network(x)[0].abs().max() <= 1) == squash
    assert network.feature_dim == 4


def test_a_log_std_is_bounded_where_it_is_a_parameter():
    network = PolicyNet(Architecture(1, 1, (2,)), init_std=0.5)
    assert network(torch.zeros(1, 1))[1].exp().item() == pytest.approx(0.5)
    torch.nn.init.constant_(network.log_std, 9.0)
    assert network(torch.zeros(1, 1))[1].item() == 1.0
