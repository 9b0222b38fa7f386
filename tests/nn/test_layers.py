import math

import numpy as np
import pytest
import torch
from torch import nn

from transferkit.nn import Architecture, Linear, Normalizer, PolicyNet, ResidualLinear, gaussian, mlp
from transferkit.nn.optimizer import Part, PartAdam
from transferkit.run.streams import Streams


def test_gaussian_against_torch_and_by_hand():
    mean, log_std, action = torch.randn(3, 5, 2, dtype=torch.float64, generator=Streams(0).torch("x"))
    expected = torch.distributions.Normal(mean, log_std.exp())
    torch.testing.assert_close(gaussian.log_prob(mean, log_std, action), expected.log_prob(action).sum(-1))
    torch.testing.assert_close(gaussian.entropy(log_std), expected.entropy().sum(-1))
    other = torch.distributions.Normal(action, mean.exp())
    kl = gaussian.kl_divergence(mean, log_std, action, mean)
    torch.testing.assert_close(kl, torch.distributions.kl_divergence(expected, other).sum(-1))
    standard = gaussian.log_prob(torch.zeros(1, 1), torch.zeros(1, 1), torch.ones(1, 1))
    assert standard.item() == pytest.approx(-0.5 - 0.5 * math.log(2 * math.pi))


def test_the_handwritten_gradient_of_the_density():
    mean, log_std, action = torch.randn(3, 4, 2, dtype=torch.float64, generator=Streams(1).torch("x"))
    torch.autograd.gradcheck(gaussian.log_prob, (mean.requires_grad_(), log_std.requires_grad_(), action))


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


def test_initialisation_leaves_the_global_generator_alone():
    torch.manual_seed(0)
    before = torch.get_rng_state()
    PolicyNet(Architecture(4, 2, std="head"), Streams(0).torch("a"))
    PolicyNet(Architecture(4, 2), Streams(0).torch("a"))
    assert torch.equal(before, torch.get_rng_state())


def test_residual_layers_start_as_the_identity():
    x = torch.randn(3, 4, generator=Streams(0).torch("x"))
    assert torch.equal(ResidualLinear(4)(x), x)


def test_the_paper_parameter_counts():
    """PPO 18,050 on InvertedDoublePendulum-v5: two heads on 128-128."""
    network = PolicyNet(Architecture(9, 1, (128, 128), "relu", "head"))
    assert sum(p.numel() for p in network.parameters()) == 18_050


@pytest.mark.parametrize("own_rate", [None, 5e-2])
def test_part_adam_equals_adam_with_a_rate_per_group_even_when_lr_is_overwritten(own_rate):
    def layers():
        generator = Streams(3).torch("layers")
        return [mlp(3, (8,), "tanh", generator, gain=1.0), Linear(8, 1, generator)]

    ours, theirs = layers(), layers()
    parts = PartAdam([Part(list(ours[0].parameters()), 0.1), Part(list(ours[1].parameters()), lr=own_rate)], 1e-2)
    groups = [{"params": theirs[0].parameters(), "lr": 1e-3}, {"params": theirs[1].parameters(), "lr": own_rate or 1e-2}]
    adam = torch.optim.Adam(groups)
    x = torch.randn(16, 3, generator=Streams(4).torch("x"))
    for k in range(5):
        if k == 3:  # what rsl_rl's adaptive schedule does
            for group in parts.param_groups:
                group["lr"] = 2e-2
            adam.param_groups[0]["lr"], adam.param_groups[1]["lr"] = 2e-3, own_rate or 2e-2
        for network, optimizer in ((ours, parts), (theirs, adam)):
            optimizer.zero_grad()
            nn.functional.mse_loss(network[1](network[0](x)), torch.ones(16, 1)).backward()
            optimizer.step()
    for a, b in zip(ours, theirs, strict=True):
        for p, q in zip(a.parameters(), b.parameters(), strict=True):
            torch.testing.assert_close(p, q, rtol=1e-5, atol=1e-7)


def test_a_frozen_part_does_not_move():
    layer = Linear(2, 1, Streams(0).torch("x"))
    optimizer = PartAdam([Part(list(layer.parameters()))], 0.1)
    for parameter in layer.parameters():
        parameter.requires_grad_(False)
    before = layer.weight.clone()
    optimizer.step()
    assert torch.equal(before, layer.weight)


def test_initial_weights_do_not_depend_on_the_number_of_threads():
    weights = []
    for threads in (2, 1):
        torch.set_num_threads(threads)
        weights.append(Linear(64, 64, Streams(0).torch("layer"), gain=1.0).weight)
        assert torch.get_num_threads() == threads
    assert torch.equal(*weights)


def test_the_papers_network_begins_as_in_its_code():
    """Orthogonal with gains sqrt(2) and 0.1, and biases as `nn.Linear` draws them."""
    network = PolicyNet(Architecture(4, 1, (128, 128), "relu", std="head"), Streams(0).torch("a"))
    first, second = network.body[0], network.body[2]
    assert torch.allclose(first.weight.T @ first.weight, 2 * torch.eye(4), atol=1e-5)
    assert torch.allclose(second.weight.T @ second.weight, 2 * torch.eye(128), atol=1e-5)
    for head in (network.mean_head, network.log_std_head):
        assert float(head.weight.norm()) == pytest.approx(0.1)
    for layer, bound in ((first, 4**-0.5), (second, 128**-0.5), (network.mean_head, 128**-0.5)):
        assert 0 < float(layer.bias.abs().max()) <= bound
