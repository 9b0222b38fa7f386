"""Whole runs, small."""

from dataclasses import replace

import pytest
import torch

from tests.runs import assert_same_run, interrupt_at
from tests.toys import Counter
from transferkit import load_core, load_policy, load_subject, make_env, run_training, scratch_policy, train, wrap
from transferkit.budget import Budget
from transferkit.config import NetworkConfig, TrainConfig, with_settings
from transferkit.errors import ConfigError, InterruptedRunError, RunDirectoryError, SettingError
from transferkit.evaluation import evaluate
from transferkit.files import read_json
from transferkit.policy.saved import load_saved
from transferkit.run import EpisodeRow, EvaluationRow, Result, load_state, read_record, read_table

IDP, CORE = "InvertedDoublePendulum-v5", "inverted-pendulum-v1"
PPO = {"ppo.epochs": 2}
DYNA = {
    "network.hidden": [16, 16],
    "dyna.updates_per_step": 2,
    "dyna.batch_size": 32,
    "dyna.model_share": 0.5,
    "model.hidden": [16],
    "model.updates": 60,
    "dyna_ppo.updates": 2,
}
BESIDE = {"ppo": {"value"}, "dyna-ddpg": {"critic", "dynamics"}, "dyna-ppo": {"dynamics", "value"}}
"""What is kept beside the policy."""


def small(algo="ppo", settings=None, **options):
    given = {"env": "InvertedPendulum-v5", "steps": 1001, "eval_episodes": 2, "checkpoint_seconds": 0.0, "eval_every": 400}
    config = TrainConfig(**{**given, **options}, algo=algo)
    return with_settings(config, (PPO if algo == "ppo" else DYNA) | (settings or {}))


@pytest.mark.parametrize(
    ("num_envs", "budget"),
    [(1, {"episodes": 7}), (8, {"episodes": 7}), (8, {"steps": 1001})],
    ids=["episodes", "episodes of eight environments", "steps of eight environments"],
)
def test_budgets_are_exact(tmp_path, num_envs, budget):
    settings = {"ppo.num_envs": num_envs, "ppo.rollout_steps": 64, "ppo.epochs": 1}
    result = run_training(small(settings=settings, **{"steps": None, **budget}), out=tmp_path / "run")
    rows = read_table(tmp_path / "run", EpisodeRow)
    assert rows["episode"].tolist() == list(range(1, result.episodes + 1))
    if "episodes" in budget:
        assert result.episodes == 7
        assert rows["steps"][-1] == result.steps
    else:
        assert result.steps == 1001
    ended = sum(rows["length"])
    assert ended <= result.steps < ended + 1000 * num_envs


@pytest.mark.parametrize(
    ("config", "steps"),
    [
        pytest.param(small(env=IDP), 384, id="ppo"),
        pytest.param(small(env=IDP, core=CORE), 384, id="ppo around a core"),
        pytest.param(small(env=IDP, core=CORE, settings={"wrap.adapter": "pad"}), 384, id="ppo around a padded core"),
        pytest.param(small(env=IDP, settings={"ppo.rollout_steps": 16}), 384, id="ppo, most rollouts longer than the least"),
        pytest.param(small(env=IDP, stop_at=1.0), 512, id="ppo, at the very evaluation that is good enough"),
        pytest.param(small("dyna-ddpg", env=IDP, steps=600, eval_every=250), 300, id="dyna-ddpg"),
        pytest.param(small("dyna-ppo", env=IDP, steps=600, eval_every=250), 300, id="dyna-ppo"),
    ],
)
def test_an_interrupted_run_goes_on_to_the_bit(tmp_path, config, steps):
    run_training(config, out=str(tmp_path / "whole"))
    with pytest.raises(InterruptedRunError, match="resume=True"):
        run_training(config, out=tmp_path / "cut", report=interrupt_at(steps))
    assert load_state(tmp_path / "cut/checkpoint.safetensors")["session"]["spent"][1] >= steps
    with (tmp_path / "cut/episodes.csv").open("a") as file:
        file.write("999,half a row that a kill left beh")
    done = run_training(config, out=tmp_path / "cut", resume=True)
    assert run_training(config, out=tmp_path / "cut", resume=True) == done  # finished: no more work
    assert_same_run(tmp_path / "whole", tmp_path / "cut")
    assert set(load_saved(tmp_path / "whole").parts) == BESIDE[config.algo]


def test_a_run_killed_before_its_first_checkpoint_starts_again(tmp_path):
    config = small(checkpoint_seconds=1e9)
    run_training(config, out=tmp_path / "whole")
    (tmp_path / "cut").mkdir()
    for name in ("run.json", "episodes.csv"):
        (tmp_path / "cut" / name).write_bytes((tmp_path / "whole" / name).read_bytes())
    (tmp_path / "cut/evaluations.csv").touch()
    run_training(config, out=tmp_path / "cut", resume=True)
    assert_same_run(tmp_path / "whole", tmp_path / "cut")


def test_a_run_is_resumed_with_its_own_settings_only(tmp_path):
    config = small(steps=200)
    run_training(config, out=tmp_path / "run")
    with pytest.raises(RunDirectoryError, match="seed is 0 there and 1 here"):
        run_training(replace(config, seed=1), out=tmp_path / "run", resume=True)
    with pytest.raises(RunDirectoryError, match=r"overrides\.ppo\.gamma is None there and 0.9 here"):
        run_training(with_settings(config, {"ppo.gamma": 0.9}), out=tmp_path / "run", resume=True)
    with pytest.raises(RunDirectoryError, match=r"policy\..* is .* there and .* here"):
        run_training(config, policy=scratch_policy(config.env, NetworkConfig(hidden=(8,))), out=tmp_path / "run", resume=True)
    unread = with_settings(replace(config, checkpoint_seconds=9.0), {"dyna.gamma": 0.5})  # of no effect
    assert run_training(unread, out=tmp_path / "run", resume=True).steps == 200


def test_the_record_is_the_configuration_and_the_result_is_the_evaluation(tmp_path):
    config = small(steps=300, core=CORE, env=IDP)
    result = run_training(config, out=tmp_path / "run")
    record = read_record(tmp_path / "run")
    assert TrainConfig.from_json(record) == config
    assert record["core_digest"] == result.core_digest == load_core(CORE).digest
    assert result == read_json(tmp_path / "run/result.json", Result)
    scores = evaluate(load_policy(tmp_path / "run"), IDP, episodes=2).scores()
    assert (result.eval_return_mean, result.eval_return_std) == (scores["return_mean"], scores["return_std"])
    assert result.preset == "default-v8"


def test_training_stops_at_an_evaluation_that_is_good_enough(tmp_path):
    result = run_training(small(stop_at=1.0), out=tmp_path / "run")
    assert read_table(tmp_path / "run", EvaluationRow)["steps"].tolist() == [0, 512]
    assert result.steps == 512
    assert run_training(small(stop_at=1e6), out=tmp_path / "whole").steps == 1001


@pytest.mark.parametrize(("frozen_share", "moves"), [(1.0, False), (0.5, True), (0.0, True)])
def test_a_frozen_core_stays_and_an_unfrozen_one_learns(tmp_path, frozen_share, moves):
    settings = {"wrap.freeze": {"core": frozen_share}, "ppo.rollout": "steps", "ppo.rollout_steps": 64}
    run_training(small(steps=300, eval_every=0, eval_episodes=1, core=CORE, settings=settings), out=tmp_path / "run")
    trained = load_policy(tmp_path / "run").state_dict()
    before = load_core(CORE).network(0).state_dict()
    names = ("body.0.weight", "body.2.weight")
    assert [not torch.equal(trained[f"core.{name}"], before[name]) for name in names] == [moves] * 2
    assert trained["output_adapter.weight"].abs().sum() > 0


def test_the_callers_threads_are_as_they_were(tmp_path):
    torch.set_num_threads(2)
    try:
        run_training(small(steps=100, eval_every=0), out=tmp_path / "run")
        assert torch.get_num_threads() == 2
    finally:
        torch.set_num_threads(1)


def test_train_does_what_the_same_configuration_does(tmp_path):
    config = small(steps=300)
    run_training(config, out=tmp_path / "run")
    policy = scratch_policy(config.env)
    result = train(
        policy, config.env, Budget(steps=300), settings=PPO, eval_episodes=2, eval_every=400, out=tmp_path / "trained"
    )
    assert result.run_dir == str(tmp_path / "trained")
    assert_same_run(tmp_path / "run", tmp_path / "trained")
    assert torch.equal(policy.network.mean_head.weight, load_policy(tmp_path / "run").network.mean_head.weight)  # in place


def test_the_papers_sandwich_is_recorded_with_its_core(tmp_path):
    policy = wrap(load_core(CORE), IDP, preset="paper", member=1)
    result = train(policy, IDP, Budget(steps=20), preset="paper", eval_episodes=1, out=tmp_path / "run")
    assert (result.core, result.member, result.core_digest) == (CORE, 1, load_core(CORE).digest)


def test_train_takes_an_environment_of_your_own_and_a_preset(tmp_path):
    policy = scratch_policy(Counter(5))
    result = train(policy, lambda: Counter(5), Budget(episodes=4), preset="paper", eval_episodes=1, out=tmp_path / "run")
    assert (result.episodes, result.steps, result.eval_return_mean, result.preset) == (4, 20, 5.0, "paper-v1")
    with pytest.raises(ConfigError, match=r"takes 2 observations and 1 actions, environment Hopper-v5 has 11 and 3"):
        train(policy, "Hopper-v5", Budget(episodes=1), out=tmp_path / "other")
    with pytest.raises(SettingError, match=r"ppo\.gamma=2\.0 must be at least 0 and at most 1"):
        train(policy, "Hopper-v5", Budget(episodes=1), settings={"ppo.gamma": 2.0}, out=tmp_path / "other")
    assert not (tmp_path / "other").exists()


def test_actions_reach_the_environment_clipped_or_not_as_the_preset_says(tmp_path):
    seen = []

    class Watched(Counter):
        def step(self, action):
            seen.append(abs(float(action[0])))
            return super().step(action)

    network = NetworkConfig(init_std=2.0)
    for clip in (True, False):
        seen.clear()
        policy = scratch_policy(Counter(5), network)
        settings = {"env_config.clip_actions": clip}
        train(policy, lambda: Watched(5), Budget(steps=64), settings=settings, eval_episodes=1, out=tmp_path / str(clip))
        assert (max(seen) <= 1.0) == clip


def test_the_rules_of_an_environment_that_was_made_are_those_of_its_run(tmp_path):
    env = make_env("InvertedPendulum-v5", max_episode_steps=3, clip_actions=False)
    result = train(scratch_policy(env), env, Budget(steps=64), eval_episodes=1, out=tmp_path / "run")
    again = load_subject(str(tmp_path / "run"))
    assert (result.eval_return_mean, again.env) == (3.0, "InvertedPendulum-v5")
    assert (again.max_episode_steps, again.clip_actions) == (3, False)


@pytest.mark.parametrize(("name", "reason"), [("cuda:77", "cannot be used .*"), ("cpu:7", "a CPU has no number")])
def test_a_device_that_is_not_there_is_refused(tmp_path, name, reason):
    with pytest.raises(ConfigError, match=f"device '{name}'.* ?{reason}; use device=cpu"):
        run_training(small(device=name), out=tmp_path / "run")
    assert not (tmp_path / "run").exists()
