import pytest
import torch

from tests.toys import Fixed, fixed_model
from transferkit.nn import Dynamics, JointInput


def test_statistics_undo_themselves():
    model = fixed_model(1.0, -1.0, 0.0, 0.0, 0.0)
    model.set_statistics(torch.tensor([[0.0], [0.0]]), torch.tensor([1.0, 3.0]), torch.tensor([[2.0], [6.0]]))
    prediction = model.predict(torch.tensor([[10.0]]), torch.tensor([[0.0]]))
    assert prediction.next_observation.item() == pytest.approx(10.0 + 4.0 + 2.0)  # mean change 4, deviation 2
    assert prediction.reward.item() == pytest.approx(2.0 - 1.0)
    targets = model.targets(torch.tensor([[10.0]]), torch.tensor([1.0]), torch.tensor([[16.0]]))
    assert targets.tolist() == [[1.0, -1.0]]  # what it says is what it is trained towards


def test_angles_stay_on_the_circle():
    model = fixed_model(0.3, 0.4, 0.0, *[0.0] * 4, angles=[(0, 1)])
    sin, cos = model.predict(torch.tensor([[0.0, 0.0]]), torch.zeros(1, 1)).next_observation[0, 0]
    assert (sin.item(), cos.item()) == pytest.approx((0.6, 0.8))


def test_a_model_of_states_does_not_add_what_was():
    model = Dynamics(JointInput(None), Fixed(0.25, 7.0, 0.0, 0.0, 0.0), 1, absolute=True)
    assert model.predict(torch.tensor([[10.0]]), torch.zeros(1, 1)).next_observation.item() == 0.25
    assert model.targets(torch.tensor([[10.0]]), torch.tensor([1.0]), torch.tensor([[16.0]])).tolist() == [[16.0, 1.0]]


def test_log_variances_are_bounded_and_the_logit_is_a_probability():
    model = fixed_model(0.0, 0.0, 90.0, -90.0, 0.0)
    _, log_var, logit = model(torch.zeros(1, 1), torch.zeros(1, 1))
    assert log_var[0, 0].tolist() == pytest.approx([0.5, -10.0], abs=1e-3)
    assert logit.shape == (1, 1)
    assert model.predict(torch.zeros(1, 1), torch.zeros(1, 1)).terminated.item() == 0.5
