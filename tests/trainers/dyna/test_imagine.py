import pytest
import torch

from tests.toys import Half, fixed_model, only, transition
from transferkit.config import DynaConfig
from transferkit.nn import Dynamics, JointInput
from transferkit.streams import Streams
from transferkit.trainers.dyna.imagine import imagine, novelty
from transferkit.trainers.dyna.replay import ReplayBuffer


def test_imagined_transitions_follow_the_model():
    model = fixed_model(0.25, 7.0, 0.0, 0.0, 9.0)  # adds 0.25, pays 7, always ends
    buffer = ReplayBuffer(1, 1, 10)
    for value in (1.0, 2.0):
        buffer.add(only(transition(value, 0.9, 0.0, 0.0, 0.0)))
    config = DynaConfig(horizon=2)
    batch = buffer.split(imagine(6, Half(), model, buffer, config, Streams(0).torch("test"), members=1))
    assert len(batch.reward) == 6
    assert set(batch.observation.flatten().tolist()) <= {1.0, 2.0}  # rollouts that ended begin anew
    torch.testing.assert_close(batch.action, batch.observation / 2)
    torch.testing.assert_close(batch.next_observation, batch.observation + 0.25)
    assert (batch.reward == 7).all()
    assert (batch.terminated == 1).all()
    paper = DynaConfig(planned_action="replayed", planned_reward="minus-norm", planned_termination=False)
    batch = buffer.split(imagine(4, Half(), model, buffer, paper, Streams(0).torch("test"), members=1))
    assert (batch.action == torch.tensor(0.9)).all()
    torch.testing.assert_close(batch.reward, -batch.next_observation[:, 0].abs())
    assert (batch.terminated == 0).all()


def test_a_rollout_goes_on_from_where_it_led():
    model, buffer = fixed_model(0.25, 7.0, 0.0, 0.0, -9.0), ReplayBuffer(1, 1, 10)  # never ends
    buffer.add(only(transition(1.0, 0.9, 0.0, 0.0, 0.0)))
    rows = imagine(3, Half(), model, buffer, DynaConfig(horizon=3), Streams(0).torch("test"), members=1)
    assert sorted(buffer.split(rows).observation.flatten().tolist()) == [1.0, 1.25, 1.5]


class Split(torch.nn.Module):
    """Two members that differ on positive observations only, by the observation."""

    def forward(self, x):
        x = x.expand(2, *x.shape[-2:])
        change = torch.stack((x[0, :, :1] * 0, x[1, :, :1].clamp(min=0)))
        return torch.cat((change, torch.zeros(2, x.shape[-2], 4)), -1)


def test_imagined_rows_on_which_members_disagree_are_dropped():
    buffer, config = ReplayBuffer(1, 1, 100), DynaConfig(keep_share=0.4, planned_action="replayed")
    for value in (-1.0, 1.0):
        buffer.add(only(transition(value, 0.0, 0.0, 0.0, 0.0)))
    rows = imagine(
        40, torch.nn.Identity(), Dynamics(JointInput(None), Split(), 1), buffer, config, Streams(0).torch("x"), members=2
    )
    assert len(rows) == 40
    assert (buffer.split(rows).observation == -1).all()


def test_novelty_is_disagreement_beside_its_mean():
    """The members differ by 0, 1 and 5, so by their mean of 2 twice as much as half."""
    buffer = ReplayBuffer(1, 1, 10)
    for value in (-1.0, 1.0, 5.0):
        buffer.add(only(transition(value, 0.0, 0.0, 0.0, 0.0)))
    found = novelty(Dynamics(JointInput(None), Split(), 1), buffer.all())
    assert found.tolist() == pytest.approx([0.0, 1 / (1 + 2), 5 / (5 + 2)])
