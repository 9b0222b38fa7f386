import torch
from torch import nn

from transferkit.nn import Critic, Ensemble, EnsembleArchitecture, JointInput, Normalizer, StateCritic
from transferkit.streams import Streams


class TwoSums(nn.Module):
    """Members that say the sum of their input, and ten times that."""

    def forward(self, x):
        total = x.sum(-1, keepdim=True)
        return torch.stack((total, 10 * total))


def statistics():
    normalizer = Normalizer(2)
    normalizer.load_state_dict({"mean": torch.tensor([1.0, 2.0]), "var": torch.tensor([4.0, 1.0]), "count": torch.tensor(9.0)})
    return normalizer


def test_a_critic_sees_observations_under_the_policys_statistics_and_actions_as_they_are():
    critic = Critic(JointInput(statistics()), TwoSums())
    observation, action = torch.tensor([[3.0, 2.0], [1.0, 5.0]]), torch.tensor([[0.5], [-1.0]])
    # (3 - 1) / 2 + 0 + 0.5 and 0 + 3 - 1
    torch.testing.assert_close(critic(observation, action), torch.tensor([[1.5, 2.0], [15.0, 20.0]]))
    torch.testing.assert_close(critic.value(observation, action), torch.tensor([8.25, 11.0]))


def test_statistics_belong_to_the_policy_that_owns_them():
    normalizer = statistics()
    critic = StateCritic(2, (4,), "tanh", Streams(0).torch("x"), gain=1.0, normalizer=normalizer)
    assert not any("mean" in name for name in (*critic.state_dict(), *Critic(JointInput(normalizer), TwoSums()).state_dict()))
    before = critic.value(torch.tensor([[3.0, 2.0]]))
    normalizer.load_state_dict({"mean": torch.tensor([3.0, 2.0]), "var": torch.ones(2), "count": torch.tensor(9.0)})
    after = critic.value(torch.tensor([[3.0, 2.0]]))
    assert before.shape == (1, 1)
    assert not torch.equal(before, after)
    torch.testing.assert_close(after, critic.head(critic.body(torch.zeros(1, 2))))


def test_without_statistics_observations_are_raw():
    x = torch.tensor([[3.0, 2.0]])
    assert JointInput(None)(x, torch.tensor([[1.0]])).tolist() == [[3.0, 2.0, 1.0]]


def test_some_members_can_be_asked_alone():
    ensemble = Ensemble(EnsembleArchitecture(3, 3, 1, (8,)), Streams(0).torch("weights"))
    critic = Critic(JointInput(statistics()), ensemble)
    inputs = torch.tensor([[3.0, 2.0], [1.0, 5.0]]), torch.tensor([[0.5], [-1.0]])
    torch.testing.assert_close(critic(*inputs, torch.tensor([2, 0])), critic(*inputs)[[2, 0]])
