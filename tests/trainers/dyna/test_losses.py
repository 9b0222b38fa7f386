"""Hand-computed losses."""

import math

import pytest
import torch
from torch import nn

from tests.toys import Half, fixed_model, transition
from transferkit.trainers.dyna.losses import actor_loss, bounded, critic_loss, dynamics_loss, td_target
from transferkit.trainers.dyna.replay import Batch


class Twice(nn.Module):
    """Two critics: the sum of observation and action, and three times that."""

    def forward(self, observation, action, members=slice(None)):
        total = observation.sum(-1) + action.sum(-1)
        return torch.stack((total, 3 * total))[members]


def test_td_target():
    def target(batch, noise=None, **options):
        batch = Batch(*(tensor[None] for tensor in batch))
        return td_target(Half(), Twice(), batch, noise, reward_scale=0.1, discount=0.9, **options).item()

    # next action -1.0, total -3.0, members -3 and -9: the least is -9
    assert target(transition(0.0, 0.0, 5.0, -2.0, 0.0)) == pytest.approx(0.5 + 0.9 * -9)
    assert target(transition(0.0, 0.0, 5.0, -2.0, 1.0)) == pytest.approx(0.5)  # ended
    # half way from the mean of -6
    assert target(transition(0.0, 0.0, 5.0, -2.0, 0.0), pessimism=0.5) == pytest.approx(0.5 + 0.9 * -7.5)
    # the first member alone is asked
    assert target(transition(0.0, 0.0, 5.0, -2.0, 0.0), members=torch.tensor([0])) == pytest.approx(0.5 + 0.9 * -3)
    # 0.5 + 0.9 is clipped to 1
    assert target(transition(0.0, 0.0, 5.0, 1.0, 0.0), torch.tensor([[0.9]])) == pytest.approx(0.5 + 0.9 * 2.0)


def test_critic_and_actor_loss():
    observation, action = torch.tensor([[1.0], [2.0]]), torch.tensor([[1.0], [0.0]])
    # members 2, 2 and 6, 6 against 1 and 2: (1 + 0) / 2 + (25 + 16) / 2
    assert critic_loss(Twice(), observation, action, torch.tensor([1.0, 2.0])).item() == pytest.approx(21.0)
    # actions 0.5 and 1, totals 1.5 and 3, mean over members 3 and 6
    assert actor_loss(Half(), Twice(), observation, squash=True).item() == pytest.approx(-4.5)
    # at first the actions were 0.25 and 0.5: squared distances 1/16 and 1/4
    first = lambda x: (Half()(x)[0] / 2, None)  # noqa: E731
    assert actor_loss(Half(), Twice(), observation, first, 2.0, squash=True).item() == pytest.approx(
        -1.0 + 2 * (1 / 16 + 1 / 4) / 2
    )


def test_gradients_are_inverted_at_the_bounds():
    action = torch.tensor([0.5, 0.5, 1.2, -1.2, 3.0], requires_grad=True)
    taken = bounded(action)
    assert taken.tolist() == [0.5, 0.5, 1.0, -1.0, 1.0]
    taken.backward(torch.tensor([-1.0, 1.0, -1.0, -1.0, 1.0]))
    # room upwards 0.5 of 2, downwards 1.5 of 2; beyond a bound the outward step turns round
    torch.testing.assert_close(action.grad, torch.tensor([-0.25, 0.75, 0.1, -1.1, 2.0]))


def test_dynamics_loss():
    model = fixed_model(0.5, 2.0, -30.0, 0.0, 0.0)  # change 0.5, reward 2, log-variances, logit
    batch = Batch(*(tensor[None] for tensor in transition(1.0, 0.0, 1.0, 1.5, 1.0)))
    low, high = -10.0, 0.5
    soft = lambda raw: low + math.log1p(math.exp(high - math.log1p(math.exp(high - raw)) - low))  # noqa: E731
    first, second = soft(-30.0), soft(0.0)
    likelihood = ((0.0 + first) + (1.0 * math.exp(-second) + second)) / 2
    target = model.targets(batch.observation, batch.reward, batch.next_observation)
    assert dynamics_loss(model, batch, target).item() == pytest.approx(0.5 * likelihood + math.log(2), rel=1e-5)
