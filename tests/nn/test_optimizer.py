import pytest
import torch
from torch import nn

from transferkit.nn import Linear, Part, PartAdam, mlp
from transferkit.streams import Streams


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


def test_gradients_are_clipped_by_the_norm_of_their_group():
    """Adam's first moment after a step is a tenth of the gradient that it took."""
    layers = [nn.Parameter(torch.zeros(1)) for _ in range(3)]
    optimizer = PartAdam(
        [Part([layers[0]], clip_group="a"), Part([layers[1]], clip_group="a"), Part([layers[2]])], 0.1, max_grad_norm=1
    )
    (3 * layers[0] + 4 * layers[1] + 0.5 * layers[2]).sum().backward()
    optimizer.step()
    moments = [float(first) for first, _ in optimizer.state_dict()["moments"]]
    torch.testing.assert_close(moments, [0.06, 0.08, 0.05])  # 3 and 4 have norm 5; 0.5 alone is below the limit


def test_an_optimiser_goes_on_from_its_state():
    def made():
        layer = Linear(2, 1, Streams(0).torch("x"))
        return layer, PartAdam([Part(list(layer.parameters()))], 0.1)

    def step(layer, optimizer):
        optimizer.zero_grad()
        layer(torch.ones(1, 2)).square().sum().backward()
        optimizer.step()

    (one, ours), (two, theirs) = made(), made()
    for group in ours.param_groups:
        group["lr"] = 0.05
    step(one, ours)
    with torch.no_grad():
        for old, new in zip(two.parameters(), one.parameters(), strict=True):
            old.copy_(new)
    theirs.load_state_dict(ours.state_dict())
    step(one, ours)
    step(two, theirs)
    assert torch.equal(one.weight, two.weight)
