"""Hand-computed losses."""

import math

import pytest
import torch
from torch import nn

from transferkit.config import DynaConfig
from transferkit.dyna.imagine import imagine
from transferkit.dyna.losses import actor_loss, bounded, critic_loss, dynamics_loss, td_target
from transferkit.dyna.replay import Batch, ReplayBuffer
from transferkit.nn import Dynamics, JointInput
from transferkit.run.streams import Streams


class Twice(nn.Module):
    """Two critics: the sum of observation and action, and three times that."""

    def forward(self, observation, action):
        total = observation.sum(-1) + action.sum(-1)
        return torch.stack((total, 3 * total))


class Half(nn.Module):
    """A policy that halves its observation."""

    squash = True

    def forward(self, observation):
        return observation[:, :1] / 2, None


def transition(observation, action, reward, following, terminated):
    row = torch.tensor
    return Batch(row([[observation]]), row([[action]]), row([reward]), row([[following]]), row([terminated]))


def test_td_target():
    config = DynaConfig(gamma=0.9, reward_scale=0.1)
    # next action -1.0, total -3.0, members -3 and -9: the least is -9
    going_on = td_target(Half(), Twice(), transition(0.0, 0.0, 5.0, -2.0, 0.0), None, config)
    assert going_on.item() == pytest.approx(0.5 + 0.9 * -9)
    ended = td_target(Half(), Twice(), transition(0.0, 0.0, 5.0, -2.0, 1.0), None, config)
    assert ended.item() == pytest.approx(0.5)
    noisy = td_target(Half(), Twice(), transition(0.0, 0.0, 5.0, 1.0, 0.0), torch.tensor([[0.9]]), config)
    assert noisy.item() == pytest.approx(0.5 + 0.9 * 2.0)  # 0.5 + 0.9 is clipped to 1


def test_critic_and_actor_loss():
    observation, action = torch.tensor([[1.0], [2.0]]), torch.tensor([[1.0], [0.0]])
    # members 2, 2 and 6, 6 against 1 and 2: (1 + 0) / 2 + (25 + 16) / 2
    assert critic_loss(Twice(), observation, action, torch.tensor([1.0, 2.0])).item() == pytest.approx(21.0)
    # actions 0.5 and 1, totals 1.5 and 3, mean over members 3 and 6
    assert actor_loss(Half(), Twice(), observation).item() == pytest.approx(-4.5)
    # at first the actions were 0.25 and 0.5: squared distances 1/16 and 1/4
    first = lambda x: (Half()(x)[0] / 2, None)  # noqa: E731
    assert actor_loss(Half(), Twice(), observation, first, 2.0).item() == pytest.approx(-1.0 + 2 * (1 / 16 + 1 / 4) / 2)


def test_gradients_are_inverted_at_the_bounds():
    action = torch.tensor([0.5, 0.5, 1.2, -1.2, 3.0], requires_grad=True)
    taken = bounded(action)
    assert taken.tolist() == [0.5, 0.5, 1.0, -1.0, 1.0]
    taken.backward(torch.tensor([-1.0, 1.0, -1.0, -1.0, 1.0]))
    # room upwards 0.5 of 2, downwards 1.5 of 2; beyond a bound the outward step turns round
    torch.testing.assert_close(action.grad, torch.tensor([-0.25, 0.75, 0.1, -1.1, 2.0]))


class Fixed(nn.Module):
    """An ensemble of one that always gives the same outputs."""

    def __init__(self, *outputs):
        super().__init__()
        self.outputs = torch.tensor(outputs)

    def forward(self, x):
        return self.outputs.expand(1, x.shape[-2], -1)


def fixed_model(*outputs, angles=()):
    return Dynamics(JointInput(None), Fixed(*outputs), (len(outputs) - 3) // 2, angles)


def test_dynamics_loss():
    model = fixed_model(0.5, 2.0, -30.0, 0.0, 0.0)  # change 0.5, reward 2, log-variances, logit
    batch = Batch(*(tensor[None] for tensor in transition(1.0, 0.0, 1.0, 1.5, 1.0)))
    low, high = -10.0, 0.5
    soft = lambda raw: low + math.log1p(math.exp(high - math.log1p(math.exp(high - raw)) - low))  # noqa: E731
    first, second = soft(-30.0), soft(0.0)
    likelihood = ((0.0 + first) + (1.0 * math.exp(-second) + second)) / 2
    assert dynamics_loss(model, batch).item() == pytest.approx(0.5 * likelihood + math.log(2), rel=1e-5)


def test_statistics_undo_themselves():
    model = fixed_model(1.0, -1.0, 0.0, 0.0, 0.0)
    model.set_statistics(torch.tensor([[0.0], [0.0]]), torch.tensor([1.0, 3.0]), torch.tensor([[2.0], [6.0]]))
    prediction = model.predict(torch.tensor([[10.0]]), torch.tensor([[0.0]]))
    assert prediction.next_observation.item() == pytest.approx(10.0 + 4.0 + 2.0)  # mean change 4, deviation 2
    assert prediction.reward.item() == pytest.approx(2.0 - 1.0)


def test_angles_stay_on_the_circle():
    model = fixed_model(0.3, 0.4, 0.0, *[0.0] * 4, angles=[(0, 1)])
    sin, cos = model.predict(torch.tensor([[0.0, 0.0]]), torch.zeros(1, 1)).next_observation[0, 0]
    assert (sin.item(), cos.item()) == pytest.approx((0.6, 0.8))


def test_imagined_transitions_follow_the_model():
    model = fixed_model(0.25, 7.0, 0.0, 0.0, 9.0)  # adds 0.25, pays 7, always ends
    buffer = ReplayBuffer(1, 1, 10)
    for value in (1.0, 2.0):
        buffer.add(Batch(*(tensor[0] for tensor in transition(value, 0.9, 0.0, 0.0, 0.0))))
    config = DynaConfig(horizon=2, model_members=1)
    batch = buffer.split(imagine(6, Half(), model, buffer, config, Streams(0).torch("test")))
    assert len(batch.reward) == 6
    assert set(batch.observation.flatten().tolist()) <= {1.0, 2.0}  # rollouts that ended begin anew
    torch.testing.assert_close(batch.action, batch.observation / 2)
    torch.testing.assert_close(batch.next_observation, batch.observation + 0.25)
    assert (batch.reward == 7).all()
    assert (batch.terminated == 1).all()
    paper = DynaConfig(planned_action="replayed", planned_reward="minus-norm", planned_termination=False, model_members=1)
    batch = buffer.split(imagine(4, Half(), model, buffer, paper, Streams(0).torch("test")))
    assert (batch.action == torch.tensor(0.9)).all()
    torch.testing.assert_close(batch.reward, -batch.next_observation[:, 0].abs())
    assert (batch.terminated == 0).all()


def test_the_buffer_forgets_the_oldest_and_makes_the_round_trip():
    buffer = ReplayBuffer(1, 1, 3)
    for value in range(5):
        buffer.add(Batch(*(tensor[0] for tensor in transition(float(value), 0.0, 0.0, 0.0, 0.0))))
    assert len(buffer) == 3
    assert buffer.recent(2).observation.flatten().tolist() == [3.0, 4.0]
    again = ReplayBuffer(1, 1, 3)
    again.restore(buffer.state())
    draws = [b.sample((4, 2), Streams(0).torch("test")) for b in (buffer, again)]
    assert torch.equal(*draws)
    assert again.recent(3).observation.flatten().tolist() == [2.0, 3.0, 4.0]
