"""What is trusted, what is refused, and what that costs."""

from dataclasses import replace
from unittest.mock import MagicMock

import gymnasium
import numpy as np
import pytest

from tests.runs import assert_same_tensors, interrupt_at, rows_without_times
from transferkit import load_core, load_policy, run_training, scratch_policy, train, wrap
from transferkit.budget import Budget
from transferkit.config import TrainConfig, with_settings
from transferkit.envs import make_env
from transferkit.errors import InterruptedRunError, RunDirectoryError
from transferkit.evaluation import ZeroPolicy
from transferkit.policy.base import ConstantPolicy
from transferkit.policy.saved import load_components
from transferkit.probation import hold_probation
from transferkit.run import EpisodeRow, EvaluationRow, Session, load_state, read_made_of, read_record, read_table

IDP, CORE = "InvertedDoublePendulum-v5", "inverted-pendulum-v2"
SMALL = {
    "ppo": {"ppo.num_envs": 1, "ppo.rollout": "steps", "ppo.rollout_steps": 32, "ppo.epochs": 1, "network.hidden": [8]},
    "dyna-ddpg": {"network.hidden": [8], "dyna.updates_per_step": 1, "dyna.batch_size": 8},
    "dyna-ppo": {"network.hidden": [8], "model.updates": 2, "model.hidden": [8], "model.every": 40, "dyna_ppo.updates": 1},
}


class Line(gymnasium.Env):
    """Ten steps; pays the action, whose sign a policy finds in the observation."""

    observation_space = gymnasium.spaces.Box(-np.inf, np.inf, (1,))
    action_space = gymnasium.spaces.Box(-1, 1, (1,))

    def reset(self, *, seed=None, options=None):
        self.t = 0
        return np.ones(1, np.float32), {}

    def step(self, action):
        self.t += 1
        return np.full(1, 1.0 + self.t, np.float32), float(action[0]), self.t == 10, False, {}


class Signed:
    """Acts by a sign and a little of what it sees."""

    act_dim = 1

    def __init__(self, sign):
        self.sign = sign

    def act(self, observation):
        return self.sign * (0.5 + 0.01 * observation)


def found(policy, budget):
    held = hold_probation(policy, Line, budget, 5, 0)
    return held and held[0]


def test_a_core_is_trusted_if_it_is_better_than_doing_nothing():
    better, worse = found(Signed(1), Budget(steps=1000)), found(Signed(-1), Budget(steps=1000))
    assert (better.accepted, worse.accepted) == (True, False)
    assert better.core == pytest.approx([10 * 0.5 + 0.01 * 55] * 5)
    assert better.zero == (0.0,) * 5
    assert (better.episodes, better.steps) == (10, 100)
    assert "p 0.031" in better.reason
    assert "\n" not in worse.reason


def test_a_core_can_be_asked_to_come_some_way_to_what_solves_the_task():
    def solvable(threshold=10.0):
        env = Line()
        env.spec = gymnasium.envs.registration.EnvSpec("Line-v0", reward_threshold=threshold)
        return env

    held = lambda env, share: hold_probation(Signed(1), env, Budget(steps=1000), 5, 0, share)[0]  # noqa: E731
    assert [held(solvable, share).accepted for share in (0.0, 0.55, 0.56)] == [True, True, False]  # 5.55 of 10
    assert "better than doing nothing by less than 5.6: mean return 5.55 against 0" in held(solvable, 0.56).reason
    for unknown in (None, "10", float("nan")):
        assert held(lambda unknown=unknown: solvable(unknown), 1.0).accepted


def test_a_pole_is_no_help_for_two_or_for_a_hopper():
    asked = {env: TrainConfig(env, core=CORE).wrap.least_gain for env in (IDP, "Hopper-v5")}
    for env, share in asked.items():
        policy = wrap(load_core(CORE), env, seed=100)
        assert not hold_probation(policy, lambda env=env: make_env(env), Budget(episodes=200), 5, 100, share)[0].accepted


def test_as_many_pairs_are_played_as_a_tenth_of_the_budget_holds():
    assert found(Signed(1), Budget(episodes=19)) is None
    assert [len(found(Signed(1), Budget(episodes=n)).zero) for n in (20, 45, 999)] == [1, 2, 5]
    one_and_a_half = found(Signed(1), Budget(steps=300))
    assert (len(one_and_a_half.core), len(one_and_a_half.zero), one_and_a_half.steps) == (2, 1, 30)
    assert one_and_a_half.accepted  # one pair of one
    assert one_and_a_half.episodes == 3


def test_a_core_that_no_pair_has_judged_is_trusted_and_that_is_said():
    unjudged = found(Signed(-1), Budget(steps=150))  # zero action was cut
    assert (unjudged.accepted, unjudged.episodes, unjudged.steps) == (True, 1, 15)
    assert "no pair of episodes ended" in unjudged.reason


def test_a_budget_whose_tenth_holds_no_pair_trusts_without_a_step():
    pendulum = lambda: make_env("InvertedPendulum-v5")  # noqa: E731 - which stands for 1000 steps if it is held
    assert hold_probation(ZeroPolicy(1), pendulum, Budget(steps=19_999), 5, 0) is None
    assert hold_probation(ZeroPolicy(1), pendulum, Budget(steps=20_000), 5, 0)[0].episodes == 10


def test_a_budget_in_seconds_is_kept_after_one_pair():
    assert [len(found(Signed(1), Budget(seconds=seconds)).zero) for seconds in (1e-6, 1e6)] == [1, 5]


def test_the_actions_that_are_learnt_from_are_those_that_the_environment_took():
    _, seen = hold_probation(Signed(3), lambda: make_env(Line()), Budget(steps=1000), 1, 0)
    assert set(np.abs(seen.action).flatten()) == {0.0, 1.0}


def test_actions_that_never_change_are_refused():
    assert found(ConstantPolicy(1, 1), Budget(steps=1000)).reason == "its actions never change"
    assert not found(ConstantPolicy(1, 1), Budget(steps=1000)).accepted


def config(algo, **options):
    given = {"env": IDP, "core": CORE, "member": 2, "seed": 102, "episodes": 60, "eval_episodes": 2, "checkpoint_seconds": 0.0}
    return with_settings(TrainConfig(**{**given, **options}, algo=algo), SMALL[algo] | {"wrap.least_gain": 0.0})


@pytest.mark.parametrize("algo", SMALL)
def test_a_refused_core_leaves_a_run_from_scratch_to_the_bit_also_if_it_is_interrupted(tmp_path, algo, caplog):
    refused = run_training(config(algo), out=tmp_path / "refused")
    said = lambda: [record.getMessage().partition(":")[0] for record in caplog.records if CORE in record.getMessage()]  # noqa: E731
    assert said() == [f"{CORE} is refused"]
    assert refused.probation is not None
    assert any("worse than doing nothing" in message for message in caplog.messages)
    assert not refused.probation.accepted
    assert refused.probation.episodes == 6
    caplog.clear()
    scratch = run_training(config(algo, core=None, member=0, episodes=54), out=tmp_path / "scratch")
    assert any("worse than doing nothing" in message for message in caplog.messages)  # which was played for that
    assert_same_tensors(*(load_state(tmp_path / name / "policy.safetensors") for name in ("refused", "scratch")))
    assert (refused.episodes, refused.steps) == (60, scratch.steps + refused.probation.steps)
    caplog.clear()
    with pytest.raises(InterruptedRunError):
        run_training(config(algo), out=tmp_path / "cut", report=interrupt_at(200))
    again = run_training(config(algo), out=tmp_path / "cut", resume=True)
    assert_same_tensors(*(load_state(tmp_path / name / "policy.safetensors") for name in ("refused", "cut")))
    assert replace(again.probation, seconds=0.0) == replace(refused.probation, seconds=0.0)
    assert len(said()) == 1  # what was decided is not decided again


class Costly(Line):
    """Its reward is no number where nothing is done."""

    def step(self, action):
        observation, reward, *ended = super().step(action)
        return observation, reward if np.any(action) else np.nan, *ended


def test_a_run_is_kept_where_doing_nothing_cannot_be_played(tmp_path, caplog):
    out = tmp_path / "run"
    assert train(scratch_policy(Costly), Costly, Budget(episodes=6), eval_episodes=1, out=out).episodes == 6
    assert (out / "result.json").exists()
    assert not any("doing nothing" in message for message in caplog.messages)


@pytest.mark.parametrize("algo", ["ppo", "dyna-ddpg"])
def test_a_trusted_core_is_trained_and_learns_from_what_was_seen(tmp_path, algo):
    trusting = with_settings(config(algo, member=0, seed=100), {"wrap.fall_back": False, "dyna.keep_peak": False})
    trusted = run_training(trusting, out=tmp_path / "run")
    assert trusted.probation.accepted
    assert read_made_of(read_record(tmp_path / "run")).probation == trusted.probation
    policy = load_policy(tmp_path / "run")
    assert policy.has_core
    assert trusted.episodes == 60
    if algo == "dyna-ddpg":
        assert int(policy.normalizer.count) == trusted.steps  # every step, also those of probation


@pytest.mark.parametrize("algo", SMALL)
def test_a_core_stands_in_for_what_is_learnt_while_that_is_behind(tmp_path, algo, monkeypatch):
    monkeypatch.setattr("transferkit.run.session.LATEST", 51)  # more episodes than are remembered: it stays behind
    result = run_training(config(algo, member=0, seed=100, eval_every=100), out=tmp_path / "run")
    assert result.fell_back
    evaluations = read_table(tmp_path / "run", EvaluationRow)
    assert set(evaluations["core"]) == {1}
    assert len(set(evaluations["return_mean"])) == 1
    assert not load_components(tmp_path / "run")  # which are of what was learnt
    saved, untrained = load_policy(tmp_path / "run"), wrap(load_core(CORE), IDP, config=config(algo).wrap, seed=100)
    assert_same_tensors(saved.state_dict(), untrained.state_dict())
    run_training(with_settings(config(algo, member=0, seed=100), {"wrap.fall_back": False}), out=tmp_path / "without")
    learnt = load_policy(tmp_path / "without")
    with pytest.raises(AssertionError):
        assert_same_tensors(learnt.state_dict(), untrained.state_dict())
    np.testing.assert_array_equal(*(rows_without_times(tmp_path / name, EpisodeRow) for name in ("run", "without")))


def test_episodes_with_noise_may_be_a_tenth_of_the_cores_gain_worse_before_it_is_held_again(tmp_path, monkeypatch):
    monkeypatch.setattr("transferkit.job.Session", given := MagicMock(side_effect=Session))
    found = run_training(config("dyna-ddpg", member=0, seed=100), out=tmp_path / "run").probation
    told = given.call_args.kwargs
    core, zero = np.mean(found.core), np.mean(found.zero)
    assert (told["to_beat"], told["leeway"]) == pytest.approx((core, (core - zero) / 10))


def test_the_core_that_stands_in_is_the_one_that_was_wrapped_also_if_it_was_trained_since(tmp_path, monkeypatch):
    monkeypatch.setattr("transferkit.run.session.LATEST", 51)
    policy, untrained = (wrap(load_core(CORE), IDP, config=config("ppo").wrap, seed=100) for _ in range(2))
    given = {"settings": SMALL["ppo"], "seed": 100, "eval_episodes": 2, "out": tmp_path / "run"}
    train(policy, IDP, Budget(episodes=40), **given)
    with pytest.raises(AssertionError):
        assert_same_tensors(policy.state_dict(), untrained.state_dict())
    assert train(policy, IDP, Budget(episodes=60), resume=True, **given).fell_back
    assert_same_tensors(load_policy(tmp_path / "run").state_dict(), untrained.state_dict())


def test_a_folder_that_is_in_use_is_refused_before_anything_is_played(tmp_path, caplog):
    (tmp_path / "mine.txt").touch()
    with pytest.raises(RunDirectoryError, match="is in use"):
        run_training(config("ppo"), out=tmp_path)
    assert not caplog.messages


def test_a_core_that_is_to_be_trusted_is_not_asked(tmp_path):
    trusting = with_settings(config("ppo"), {"wrap.probation": 0})
    result = run_training(trusting, out=tmp_path / "run")
    assert result.probation is None
    assert load_policy(tmp_path / "run").has_core


def test_presets_of_before_do_not_ask():
    assert TrainConfig(IDP, preset="default-v3", core=CORE).wrap.probation == 0
    assert wrap(load_core(CORE), IDP).config.probation == 5
    assert not scratch_policy(IDP).has_core
