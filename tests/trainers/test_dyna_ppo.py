import pytest
import torch

from transferkit import load_policy, run_training, scratch_policy
from transferkit.config import TrainConfig, with_settings
from transferkit.errors import ConfigError
from transferkit.nn import Architecture
from transferkit.policy.base import ScratchPolicy
from transferkit.streams import Streams
from transferkit.trainers.dyna_ppo import DynaPPOTrainer

ENV = "InvertedPendulum-v5"


@pytest.mark.parametrize(("settings", "rate"), [({}, 1.5e-4), ({"ppo.schedule": "fixed"}, 3e-4)], ids=["linear", "fixed"])
def test_its_preset_has_no_steps_by_kl_divergence(pendulum_spec, settings, rate):
    config = with_settings(TrainConfig(ENV, algo="dyna-ppo"), {"model.hidden": [8], **settings})
    policy = ScratchPolicy.create(Architecture(4, 1, (8,)), Streams(0).torch("policy"), init_std=0.5, normalize=False)
    trainer = DynaPPOTrainer(policy, pendulum_spec, config, Streams(0), torch.device("cpu"))
    trainer.algorithm.set_progress(0.5, 0)
    assert trainer.algorithm.learning_rate == pytest.approx(rate)
    assert trainer.algorithm.optimizer.parts[-1].lr is None
    assert trainer.rule.capacity == config.dyna_ppo.horizon


def test_a_rollout_of_one_step_in_many_environments_teaches(tmp_path):
    config = with_settings(
        TrainConfig(ENV, algo="dyna-ppo", steps=300, eval_episodes=1),
        {"network.hidden": [8], "model.hidden": [8], "model.updates": 20, "dyna_ppo.horizon": 1},
    )
    run_training(config, out=tmp_path / "run")
    begun = scratch_policy(ENV, config.network)
    assert not torch.equal(load_policy(tmp_path / "run").network.mean_head.weight, begun.network.mean_head.weight)


def test_a_budget_too_small_for_dyna_ppo_is_refused(tmp_path):
    with pytest.raises(ConfigError, match=r"before dyna-ppo learnt anything: it learns every 250; give it more steps, or"):
        run_training(TrainConfig(ENV, algo="dyna-ppo", steps=100), out=tmp_path / "run")
