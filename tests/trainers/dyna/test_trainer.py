import importlib
import signal
from dataclasses import replace

import numpy as np
import pytest
import torch

from transferkit.config import DYNA_PRESETS, DynaConfig, TrainConfig
from transferkit.dyna.diagnostics import diagnose
from transferkit.dyna.replay import Batch, ReplayBuffer
from transferkit.envs import derive_spec
from transferkit.errors import DivergedError, Interrupted
from transferkit.nn import Dynamics, Ensemble, EnsembleArchitecture, JointInput
from transferkit.policy import wrap
from transferkit.policy.parts import make_critic, make_dynamics
from transferkit.run.directory import read_table
from transferkit.run.files import load_state
from transferkit.run.session import Session
from transferkit.run.streams import Streams
from transferkit.trained import load_parts, load_policy
from transferkit.transfer import run_training

IDP = "InvertedDoublePendulum-v5"
TINY = DynaConfig(hidden=(16, 16), model_hidden=(16,), updates_per_step=2, batch_size=32, model_share=0.5, model_updates=60)
SMALL = TrainConfig(IDP, algo="dyna-ddpg", steps=800, eval_episodes=2, eval_every=300, checkpoint_seconds=0.0, dyna=TINY)


@pytest.mark.parametrize("algo", ["dyna-ddpg", "dyna-ppo"])
def test_training_is_the_same_to_the_bit_after_an_interruption(tmp_path, monkeypatch, algo):
    config = replace(SMALL, algo=algo)
    whole = run_training(config, out=tmp_path / "whole")
    checkpoint = Session.checkpoint

    def interrupt(self, state):
        checkpoint(self, state)
        if self.spent.steps == 500 and not monkeypatch.undo():
            signal.raise_signal(signal.SIGINT)

    monkeypatch.setattr(Session, "checkpoint", interrupt)
    with pytest.raises(Interrupted, match="--resume"):
        run_training(config, out=tmp_path / "cut")
    resumed = run_training(config, out=tmp_path / "cut", resume=True)
    assert resumed.eval_return_mean == whole.eval_return_mean
    for table in ("episodes", "evaluations", "model"):
        whole_rows, cut_rows = (
            [[value for name, value in row.items() if name != "seconds"] for row in read_table(tmp_path / run, table)]
            for run in ("whole", "cut")
        )
        assert whole_rows
        np.testing.assert_array_equal(whole_rows, cut_rows)
    weights = [load_policy(tmp_path / run).state_dict() for run in ("whole", "cut")]
    assert all(torch.equal(weights[0][name], weights[1][name]) for name in weights[0])
    parts = [load_parts(tmp_path / run) for run in ("whole", "cut")]
    assert "dynamics" in parts[0]
    for name in parts[0]:
        assert all(torch.equal(parts[0][name][1][key], tensor) for key, tensor in parts[1][name][1].items())


def test_the_paper_preset_runs_past_the_end_of_its_first_episode(tmp_path):
    dyna = replace(DYNA_PRESETS["paper"], hidden=(16, 16), model_hidden=(16, 16))
    config = replace(SMALL, preset="paper", steps=None, episodes=3, dyna=dyna, eval_every=0)
    run_training(config, out=tmp_path / "run")
    lengths = [row["length"] for row in read_table(tmp_path / "run", "episodes")]
    assert lengths[0] >= 128
    assert max(lengths[1:]) < 128


def test_diverging_values_stop_the_run(tmp_path, monkeypatch):
    monkeypatch.setattr(importlib.import_module("transferkit.dyna.train"), "EXCESS", 1e-3)
    with pytest.raises(DivergedError, match=r"last good checkpoint.*--dyna.critic-learning-rate"):
        run_training(replace(SMALL, dyna=TINY), out=tmp_path / "run")


def test_ensemble_members_are_independent():
    ensemble = Ensemble(EnsembleArchitecture(2, 3, 1, (8,)), Streams(0).torch("test"))
    x = torch.randn(5, 3, generator=Streams(0).torch("x"))
    both = ensemble(x)
    torch.testing.assert_close(ensemble(torch.stack((x, x.flip(0))))[0], both[0])
    with torch.no_grad():
        ensemble.body[0].weight[1] += 1
    assert torch.equal(ensemble(x)[0], both[0])
    assert not torch.equal(ensemble(x)[1], both[1])


def test_a_wrapped_critic_on_its_own_source_is_the_cores(core_with_parts):
    core = core_with_parts
    policy = wrap(core, core.spec)
    critic = make_critic(policy, DynaConfig(critics=2, wrap_critic=True), Streams(0).torch("test"))
    observation, action = torch.randn(7, 4, generator=Streams(0).torch("x")), torch.full((7, 1), 0.3)
    torch.testing.assert_close(critic(observation, action), core.critic()(observation, action))
    fresh = make_critic(policy, DynaConfig(critics=2), Streams(0).torch("test"))
    assert isinstance(fresh.ensemble, Ensemble)


def test_wrapped_parts_train_on_another_robot(core_with_parts, tmp_path, monkeypatch):
    core = core_with_parts
    monkeypatch.setattr("transferkit.transfer.load_core", lambda _: core)
    config = replace(SMALL, core="test-v1", dyna=replace(TINY, model_members=3), steps=400)
    before = make_dynamics(wrap(core, IDP), derive_spec(IDP), config.dyna, Streams(0).torch("x")).state_dict()
    run_training(config, out=tmp_path / "run")
    saved = load_state(tmp_path / "run/policy.safetensors")["parts"]["dynamics"]["weights"]
    assert saved.keys() == before.keys()
    assert not torch.equal(saved["ensemble.core.body.0.weight"], before["ensemble.core.body.0.weight"])


def test_diagnosis_of_a_model_that_adds_one():
    class AddsOne(torch.nn.Module):
        def forward(self, x):
            return torch.tensor([1.0, 5.0, 0.0, 0.0, -9.0]).expand(1, x.shape[-2], -1)

    model, buffer = Dynamics(JointInput(None), AddsOne(), 1), ReplayBuffer(1, 1, 1000)
    for episode in range(3):
        for k in range(30):  # the truth adds two
            row = torch.tensor([float(2 * k)]), torch.zeros(1), torch.tensor(5.0), torch.tensor([2.0 * k + 2])
            buffer.add(Batch(*row, torch.tensor(float(k == 29 and episode < 2))))
    found = diagnose(model, buffer)
    deviation = buffer.all().observation.std()
    assert found["error_1"] == pytest.approx(1 / deviation.item())
    assert found["error_20"] == pytest.approx(20 / deviation.item())  # within episodes only
    assert found["reward_error"] == 0
    assert found["termination_accuracy"] == pytest.approx(88 / 90)
    assert found["terminations_found"] == 0
