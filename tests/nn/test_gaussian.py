import math

import pytest
import torch

from transferkit.nn import gaussian
from transferkit.streams import Streams


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
