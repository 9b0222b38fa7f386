import pytest
import torch
from torch import nn

from transferkit.nn import Learner, Linear, Part, mlp
from transferkit.streams import Streams


def descend(learner, loss_of, lr=1.0):
    weights = learner.weights()
    learner.descend(loss_of(lambda *inputs: learner(weights, *inputs)), weights, learner.optimizer.rates(1)[0])


@pytest.mark.parametrize("own_rate", [None, 5e-2])
def test_part_adam_equals_adam_with_a_rate_per_group_even_when_lr_is_overwritten(own_rate):
    def network():
        generator = Streams(3).torch("layers")
        return nn.Sequential(mlp(3, (8,), "tanh", generator, gain=1.0), Linear(8, 1, generator))

    ours, theirs = network(), network()
    parts = [Part(list(ours[0].parameters()), 0.1), Part(list(ours[1].parameters()), lr=own_rate)]
    learner = Learner(ours, parts, 1e-2)
    groups = [{"params": theirs[0].parameters(), "lr": 1e-3}, {"params": theirs[1].parameters(), "lr": own_rate or 1e-2}]
    adam = torch.optim.Adam(groups)
    x = torch.randn(16, 3, generator=Streams(4).torch("x"))
    for k in range(5):
        if k == 3:  # what an adaptive schedule does
            for group in learner.optimizer.param_groups:
                group["lr"] = 2e-2
            adam.param_groups[0]["lr"], adam.param_groups[1]["lr"] = 2e-3, own_rate or 2e-2
        adam.zero_grad()
        nn.functional.mse_loss(theirs(x), torch.ones(16, 1)).backward()
        adam.step()
        descend(learner, lambda network: nn.functional.mse_loss(network(x), torch.ones(16, 1)))
    for p, q in zip(ours.parameters(), theirs.parameters(), strict=True):
        torch.testing.assert_close(p, q, rtol=1e-5, atol=1e-7)


def test_a_frozen_part_does_not_move_and_counts_no_step():
    layer = Linear(2, 1, Streams(0).torch("x"))
    learner = Learner(layer, [Part(list(layer.parameters()))], 0.1)
    layer.requires_grad_(requires_grad=False)
    before = layer.weight.clone()
    descend(learner, lambda network: network(torch.ones(1, 2)).sum())
    assert torch.equal(before, layer.weight)
    assert learner.optimizer.state_dict()["steps"] == [0]


def test_an_optimiser_goes_on_from_its_state():
    def made():
        layer = Linear(2, 1, Streams(0).torch("x"))
        return layer, Learner(layer, [Part(list(layer.parameters()))], 0.1)

    def step(learner):
        descend(learner, lambda network: network(torch.ones(1, 2)).square().sum())

    (one, ours), (two, theirs) = made(), made()
    ours.optimizer.param_groups[0]["lr"] = 0.05
    step(ours)
    with torch.no_grad():
        for old, new in zip(two.parameters(), one.parameters(), strict=True):
            old.copy_(new)
    theirs.optimizer.load_state_dict(ours.optimizer.state_dict())
    step(ours)
    step(theirs)
    assert torch.equal(one.weight, two.weight)
