import pytest
import torch

from tests.toys import Fixed, only, transition
from transferkit.config import ModelConfig
from transferkit.nn import Dynamics, Ensemble, EnsembleArchitecture, JointInput, Learner, Part
from transferkit.streams import Streams
from transferkit.trainers.dyna.fit import fit
from transferkit.trainers.dyna.imagined_env import ImaginedEnv
from transferkit.trainers.dyna.replay import ReplayBuffer


@pytest.fixture(scope="module")
def buffer():
    """Transitions of x' = x + a, reward a, an end beyond 2."""
    made, generator = ReplayBuffer(1, 1, 1000), Streams(0).torch("transitions")
    for _ in range(1000):
        observation, action = torch.randn((), generator=generator).item(), torch.rand((), generator=generator).item() * 2 - 1
        following = observation + action
        made.add(only(transition(observation, action, action, following, float(following > 2))))
    return made


@pytest.fixture(scope="module")
def model(buffer):
    ensemble = Ensemble(EnsembleArchitecture(3, 2, Dynamics.out_dim(1), (32,)), Streams(0).torch("model"))
    made = Dynamics(JointInput(None), ensemble, 1)
    config = ModelConfig(updates=600, hidden=(32,), members=3)
    fit(Learner(made, [Part(list(made.parameters()))], 3e-3), buffer, config, Streams(0).torch("fit"))
    return made


def test_the_model_learns_changes_rewards_and_ends(model):
    test, action = torch.linspace(-1.5, 1.5, 20).unsqueeze(1), torch.full((20, 1), 0.4)
    prediction = model.predict(test, action)
    assert (prediction.next_observation.mean(0) - test - 0.4).abs().max() < 0.15
    assert (prediction.reward.mean(0) - 0.4).abs().max() < 0.15
    assert model.predict(torch.tensor([[1.9]]), torch.tensor([[0.9]])).terminated.mean() > 0.5
    assert model.predict(torch.tensor([[-1.0]]), torch.tensor([[0.0]])).terminated.mean() < 0.5


def test_the_imagined_env_follows_the_model(model, buffer):
    envs = ImaginedEnv(model, buffer, 6, members=3, horizon=3, generator=Streams(0).torch("world"))
    start = envs.reset()
    steps = [envs.step(torch.full((6, 1), -0.5).numpy()) for _ in range(3)]
    assert abs(steps[0].final_observation - (start - 0.5)).max() < 0.2
    assert [step.truncated.any() for step in steps] == [False, False, True]
    assert (steps[2].observation != steps[2].final_observation).all()  # all began anew


def test_a_fit_that_no_longer_gains_stops_early(buffer):
    """A model that cannot learn is looked at before its first and before its fifty-first update."""

    class Stuck(Fixed):
        def __init__(self):
            super().__init__(0.0, 0.0, 0.0, 0.0, 0.0)
            self.unused, self.calls = torch.nn.Parameter(torch.zeros(1)), 0

        def forward(self, x):
            self.calls += torch.is_grad_enabled()
            return super().forward(x) + 0 * self.unused

    model = Dynamics(JointInput(None), Stuck(), 1)
    learner = Learner(model, [Part(list(model.parameters()))], 1e-3)
    fit(learner, buffer, ModelConfig(members=1, updates=250), Streams(0).torch("fit"))
    assert model.ensemble.calls == 50
    fit(learner, buffer, ModelConfig(members=1, updates=50), Streams(0).torch("fit"))
    assert model.ensemble.calls == 100  # so few are all done
