"""What finished runs hold, as it was when they ended."""

from dataclasses import asdict, replace

import pytest
import torch

from transferkit import trained, transfer
from transferkit.config import DynaConfig, PPOConfig, TrainConfig, WrapConfig
from transferkit.errors import RunDirectoryError
from transferkit.run.streams import Streams
from transferkit.trained import load_policy, load_value
from transferkit.transfer import run_training

ENV = "InvertedDoublePendulum-v5"
TINY = TrainConfig(
    ENV,
    steps=400,
    eval_episodes=1,
    ppo=PPOConfig(num_envs=1, rollout_steps=64, epochs=1, hidden=(8,)),
    dyna=DynaConfig(hidden=(16, 16), model_hidden=(16,), updates_per_step=1, batch_size=32, critics=2, wrap_critic=True),
)


@pytest.mark.parametrize(("algo", "core"), [("ppo", None), ("ppo", "test-v1"), ("dyna-ddpg", None), ("dyna-ddpg", "test-v1")])
def test_values_are_those_of_the_trained_critics(algo, core, core_with_parts, tmp_path, monkeypatch):
    for module in (trained, transfer):
        monkeypatch.setattr(module, "load_core", lambda _: core_with_parts)
    kept, state_of = [], transfer.state_of
    monkeypatch.setattr(transfer, "state_of", lambda policy, parts: (kept.extend(parts.values()), state_of(policy, parts))[1])
    config = replace(TINY, algo=algo, core=core)
    run_training(config, out=tmp_path / "run")
    assert TrainConfig.from_json(transfer.read_json(tmp_path / "run" / transfer.RECORD)["config"]) == config
    generator = Streams(0).torch("x")
    observation, action = torch.randn(6, 9, generator=generator), torch.rand(6, 1, generator=generator)
    critic = kept[0]
    expected = critic.value(observation).squeeze(-1) if algo == "ppo" else critic(observation, action).mean(0)
    value = load_value(tmp_path / "run", load_policy(tmp_path / "run"))
    torch.testing.assert_close(value(observation, action), expected)
    if core:
        monkeypatch.setattr(trained, "load_core", lambda _: replace(core_with_parts, digest="another"))
        if algo == "dyna-ddpg":
            with pytest.raises(RunDirectoryError, match="no longer the one"):
                load_value(tmp_path / "run", load_policy(tmp_path / "run"))


def test_a_record_is_its_configuration():
    config = TrainConfig(ENV, wrap=WrapConfig(freeze={"core": 0.5}), experience=("a.mcap",), algo="dyna-ddpg")

    record = {**asdict(config), "policy": {}}
    assert TrainConfig.from_json(record) == config
    del record["experience"]
    assert TrainConfig.from_json(record) == replace(config, experience=())
