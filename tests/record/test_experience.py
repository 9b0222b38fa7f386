from dataclasses import replace

import pytest

from tests.runs import assert_same_run, interrupt_at
from transferkit import derive_spec, read_transitions, run_training
from transferkit.config import TrainConfig, with_settings
from transferkit.errors import InterruptedRunError, SettingError

ENV = "Hopper-v5"

TINY = {
    "network.hidden": [16, 16],
    "dyna.updates_per_step": 1,
    "dyna.batch_size": 32,
    "dyna.model_share": 0.5,
    "model.hidden": [16],
    "model.updates": 20,
}


def test_training_starts_from_recordings_and_resumes_to_the_bit(recording, tmp_path):
    config = TrainConfig(ENV, algo="dyna-ddpg", steps=300, eval_episodes=1, checkpoint_seconds=0.0)
    config = replace(with_settings(config, TINY), experience=(str(recording),))
    whole = run_training(config, out=tmp_path / "whole")
    assert whole.prior_steps == len(read_transitions(recording, derive_spec(ENV)))
    assert whole.steps == 300
    with pytest.raises(InterruptedRunError):
        run_training(config, out=tmp_path / "cut", report=interrupt_at(200))
    resumed = run_training(config, out=tmp_path / "cut", resume=True)
    assert resumed.prior_steps == whole.prior_steps
    assert_same_run(tmp_path / "whole", tmp_path / "cut")


def test_more_experience_than_is_remembered_is_refused(recording, tmp_path):
    config = with_settings(TrainConfig(ENV, algo="dyna-ddpg", steps=300), {"dyna.buffer_size": 10})
    with pytest.raises(SettingError, match=r"dyna.buffer_size=10 must be at least the \d+ steps of experience"):
        run_training(replace(config, experience=(str(recording),)), out=tmp_path / "run")
    assert not (tmp_path / "run").exists()
