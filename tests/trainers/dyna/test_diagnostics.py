import pytest
import torch

from tests.toys import fixed_model, only, transition
from transferkit.trainers.dyna.diagnostics import diagnose
from transferkit.trainers.dyna.replay import ReplayBuffer


def test_diagnosis_of_a_model_that_adds_one():
    model, buffer = fixed_model(1.0, 5.0, 0.0, 0.0, -9.0), ReplayBuffer(1, 1, 1000)
    for episode in range(3):
        for k in range(30):  # the truth adds two
            buffer.add(only(transition(2.0 * k, 0.0, 5.0, 2.0 * k + 2, float(k == 29 and episode < 2))))
    found = diagnose(model, buffer, 90)
    deviation = buffer.all().observation.std().item()
    assert found.steps == 90
    assert found.error_1 == pytest.approx(1 / deviation)
    assert found.error_5 == pytest.approx(5 / deviation)
    assert found.error_20 == pytest.approx(20 / deviation)  # within episodes only
    assert found.disagreement == 0
    assert found.reward_error == 0
    assert found.termination_accuracy == pytest.approx(88 / 90)
    assert found.terminations_found == 0


def test_what_cannot_be_measured_is_no_number():
    buffer = ReplayBuffer(1, 1, 10)
    for k in range(3):
        buffer.add(only(transition(float(k), 0.0, float(k), k + 1.0, 0.0)))
    found = diagnose(fixed_model(1.0, 5.0, 0.0, 0.0, -9.0), buffer, 3)
    assert found.error_1 == 0
    assert torch.isnan(torch.tensor([found.error_5, found.error_20, found.terminations_found])).all()
