"""What finished runs hold, as it was when they ended."""

import shutil
from dataclasses import replace
from functools import partial

import pytest
import torch

from transferkit import derive_spec, evaluate, load_core, load_policy, load_subject, match, run_training
from transferkit.budget import Budget
from transferkit.config import EnvConfig, TrainConfig, with_settings
from transferkit.envs import VectorEnv, find_mirror, make_env
from transferkit.errors import ConfigError, RunDirectoryError, UnknownNameError
from transferkit.evaluation import Evaluation
from transferkit.matching import save_match
from transferkit.nn import one_thread
from transferkit.policy.make import new_policy
from transferkit.run import RunDirectory, Session
from transferkit.streams import Streams
from transferkit.subject import evaluate_subject, load_value
from transferkit.trainers.loop import train_and_evaluate
from transferkit.trainers.make import make_trainer

ENV = "InvertedDoublePendulum-v5"
TINY = {
    "ppo": {"ppo.num_envs": 1, "ppo.rollout_steps": 64, "ppo.epochs": 1, "network.hidden": [8]},
    "dyna-ddpg": {
        "network.hidden": [16, 16],
        "dyna.updates_per_step": 1,
        "dyna.batch_size": 32,
        "model.hidden": [16],
        "dyna.critics": 2,
        "dyna.drawn_critics": "none",
        "wrap.critic": True,
    },
}


def tiny(algo, core=None):
    config = TrainConfig(ENV, algo=algo, steps=200, eval_episodes=1, core=None if core is None else str(core))
    return with_settings(config, TINY[algo])


@one_thread()
def trained_by_hand(config, folder):
    """The trainer of a run of one environment, after it has done all that `run_training` makes it do."""
    core = None if config.core is None else load_core(config.core)
    policy, streams = new_policy(config, core), Streams(config.seed)
    trainer = make_trainer(policy, config, partial(derive_spec, ENV), partial(find_mirror, ENV), streams, torch.device("cpu"))
    envs = VectorEnv([make_env(ENV)], partial(streams.integer, "environment"))
    with RunDirectory.create(folder, {}) as directory:
        session = Session(directory, Budget(steps=config.steps), 1, evaluate=lambda _: Evaluation((0.0,), (1,)))
        train_and_evaluate(trainer, envs, session)
    return policy, trainer


@pytest.mark.parametrize("wrapped", [False, True], ids=["scratch", "core"])
@pytest.mark.parametrize("algo", ["ppo", "dyna-ddpg"])
def test_values_are_those_of_the_trained_critics(algo, wrapped, full_core_folder, tmp_path):
    config, run = tiny(algo, full_core_folder if wrapped else None), tmp_path / "run"
    run_training(config, out=run)
    policy, trainer = trained_by_hand(config, tmp_path / "hand")
    generator = Streams(0).torch("x")
    observation, action = torch.randn(6, 9, generator=generator), torch.rand(6, 1, generator=generator)
    loaded = load_policy(run)
    torch.testing.assert_close(loaded(observation), policy(observation))
    if algo == "ppo":
        expected = trainer.trained()["value"].value(observation).squeeze(-1)
    else:
        expected = trainer.trained()["critic"](observation, action).mean(0)
    torch.testing.assert_close(load_value(run, loaded)(observation, action), expected)
    torch.testing.assert_close(load_subject(str(run)).value(observation, action), expected)


def test_values_outlive_the_file_of_the_match(full_core_folder, tmp_path):
    file, run = tmp_path / "match.yaml", tmp_path / "run"
    save_match(match(load_core(full_core_folder), ENV), file)
    run_training(replace(tiny("dyna-ddpg", full_core_folder), match=str(file)), out=run)
    before = load_subject(str(run)).value(torch.ones(1, 9), torch.ones(1, 1))
    file.unlink()
    torch.testing.assert_close(load_subject(str(run)).value(torch.ones(1, 9), torch.ones(1, 1)), before)


def test_a_wrapped_critic_needs_the_core_that_it_was_trained_with(full_core, full_core_folder, save, tmp_path, caplog):
    run = tmp_path / "run"
    run_training(tiny("dyna-ddpg", full_core_folder), out=run)
    shutil.rmtree(full_core_folder)
    save(full_core.randomized(0), full_core_folder)
    with pytest.raises(RunDirectoryError, match=r"core .* is no longer the one that .* was trained with; restore it"):
        load_value(run, load_policy(run))
    assert load_subject(str(run)).value is None
    assert "values are not recorded" in caplog.text
    assert load_subject(str(run), values=False).policy.has_core


def test_a_run_is_evaluated_as_it_was_and_plays_its_own_environment_or_is_wrapped(tmp_path):
    result = run_training(tiny("ppo"), out=tmp_path / "run")
    assert evaluate_subject(load_subject(str(tmp_path / "run")), episodes=1).mean == result.eval_return_mean
    subject = load_subject(str(tmp_path / "run"))
    assert (subject.env, subject.clip_actions) == (ENV, True)
    assert subject.about["training"] == {
        "algo": "ppo", "preset": "default-v8", "core": None, "member": 0, "seed": 0, "core_digest": None,
    }  # fmt: skip
    other = load_subject(str(tmp_path / "run"), env="InvertedPendulum-v5")  # as a core
    assert (other.env, other.policy.obs_dim, other.about["core"]) == ("InvertedPendulum-v5", 4, "run")
    with pytest.raises(ConfigError, match="has no members; leave out member"):
        load_subject(str(tmp_path / "run"), member=1)


def test_a_core_plays_its_source_or_is_wrapped(full_core_folder):
    own, wrapped = load_subject("inverted-pendulum-v1", member=1), load_subject("inverted-pendulum-v1", env=ENV)
    assert (own.env, own.value, own.about["member"]) == ("InvertedPendulum-v5", None, 1)
    assert evaluate(own.policy, own.env, episodes=1).mean == 1000
    assert (wrapped.env, wrapped.policy.obs_dim) == (ENV, 9)
    assert load_subject(str(full_core_folder)).value(torch.zeros(2, 4), torch.zeros(2, 1)).shape == (2,)
    with pytest.raises(UnknownNameError, match="unknown run or core 'nothing-v1'"):
        load_subject("nothing-v1")


def test_an_unfinished_run_holds_no_policy(tmp_path):
    RunDirectory.create(tmp_path / "run", {}).close()
    with pytest.raises(RunDirectoryError, match="holds no finished run; finish it with resume=True"):
        load_policy(tmp_path / "run")
    (tmp_path / "run/policy.safetensors").write_bytes(b"no tensors")
    with pytest.raises(RunDirectoryError, match="is damaged"):
        load_policy(tmp_path / "run")


def test_a_run_is_wrapped_onto_another_robot_of_the_same_dimensions(tmp_path):
    config = TrainConfig("HalfCheetah-v5", steps=64, eval_episodes=1, env_config=EnvConfig(max_episode_steps=20))
    run_training(config, out=tmp_path / "run")
    named = {env: load_subject(str(tmp_path / "run"), env=env).wrapped for env in ("HalfCheetah-v5?vary.gear=2", "Walker2d-v5")}
    assert named == {"HalfCheetah-v5?vary.gear=2": False, "Walker2d-v5": True}
    assert not load_subject(str(tmp_path / "run"), env=make_env("HalfCheetah-v5")).wrapped
