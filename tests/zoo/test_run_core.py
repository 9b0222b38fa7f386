"""Finished runs as cores."""

import hashlib
import shutil
from functools import partial

import pytest
import torch

from tests.runs import assert_same_run, interrupt_at
from tests.toys import Counter
from transferkit import load_core, load_policy, load_subject, run_training, scratch_policy, train, wrap
from transferkit.budget import Budget
from transferkit.config import TrainConfig, with_settings
from transferkit.errors import (
    ArtifactError,
    EnvironmentContractError,
    InterruptedRunError,
    RunDirectoryError,
    SettingError,
    UnknownNameError,
)
from transferkit.files import read_json, write_json
from transferkit.policy.blueprints import MOST_NESTED
from transferkit.policy.composed import ComposedNet
from transferkit.run import RunDirectory, read_record
from transferkit.streams import Streams
from transferkit.subject import evaluate_subject, load_value

IP, IDP, CORE = "InvertedPendulum-v5", "InvertedDoublePendulum-v5", "inverted-pendulum-v1"
SMALL = {
    "ppo": {"ppo.num_envs": 1, "ppo.rollout": "steps", "ppo.rollout_steps": 32, "ppo.epochs": 1},
    "dyna-ddpg": {"dyna.updates_per_step": 1, "dyna.batch_size": 8, "dyna.keep_model": True, "model.every": 20},
}


def small(env=IP, algo="ppo", steps=100, settings=None, **options):
    config = TrainConfig(env, algo=algo, steps=steps, eval_episodes=1, checkpoint_seconds=0.0, **options)
    made = {} if config.core else {"network.hidden": [8]}
    return with_settings(config, ({} if config.preset == "paper-v1" else SMALL[algo] | made) | (settings or {}))


def done(out, **options):
    run_training(small(**options), out=out)
    return out


def observations(dim, scale=0.2):
    return scale * torch.randn(16, dim, generator=Streams(3).torch("x"))


def assert_acts_alike(one, other, observation):
    for a, b in zip(one(observation), other(observation), strict=True):
        torch.testing.assert_close(a, b, atol=1e-5, rtol=1e-4)


@pytest.mark.parametrize("algo", ["ppo", "dyna-ddpg"])
def test_a_run_from_scratch_is_a_core_of_all_that_it_kept(tmp_path, algo):
    run = done(tmp_path / "first", algo=algo, seed=3)
    core, policy = load_core(run), load_policy(run)
    assert (core.id, core.seeds, core.spec.env_id) == ("first", (3,), IP)
    assert core.digest == hashlib.sha256((run / "policy.safetensors").read_bytes()).hexdigest()
    assert set(core.ensembles) == ({"critic", "dynamics"} if algo == "dyna-ddpg" else set())
    observation = observations(4)
    assert all(torch.equal(a, b) for a, b in zip(core.policy()(observation), policy(observation), strict=True))
    assert_acts_alike(wrap(core, IP), policy, observation)
    if algo == "dyna-ddpg":
        action = torch.zeros(16, 1)
        torch.testing.assert_close(core.critic().value(observation, action), load_value(run, policy)(observation, action))


@pytest.mark.parametrize(
    "settings",
    [
        {},
        {"wrap.residual": 0, "wrap.finetune": False},
        {"wrap.tap": "action"},
        {"wrap.adapter": "random"},
    ],
    ids=["default", "bare", "action", "random"],
)
@pytest.mark.parametrize("tap", ["features", "action"])
def test_a_run_around_a_core_is_a_core_as_a_whole(tmp_path, settings, tap):
    run = done(tmp_path / "wrapped", core=CORE, settings=settings)
    core, policy, observation = load_core(run), load_policy(run), observations(4)
    assert isinstance(core.network(), ComposedNet)
    assert_acts_alike(core.policy(), policy, observation)
    assert_acts_alike(wrap(core, IP, tap=tap), policy, observation)


def test_a_run_of_the_papers_sandwich_is_a_core_too(tmp_path):
    run = done(tmp_path / "paper", core=CORE, preset="paper")
    core, policy, observation = load_core(run), load_policy(run), observations(4)
    wrapped = wrap(core, IP, tap="features")
    torch.testing.assert_close(wrapped(observation)[0], policy(observation)[0], atol=1e-5, rtol=1e-4)
    assert wrap(core, IDP, preset="paper")(observations(9))[0].shape == (16, 1)


@pytest.mark.parametrize("algo", ["ppo", "dyna-ddpg"])
def test_fine_tuning_of_fine_tuning_goes_on_to_the_bit_and_is_recorded(tmp_path, algo):
    first = done(tmp_path / "first", core=CORE, algo=algo)
    settings = {"wrap.freeze": {"core": 0.5}, "dyna.keep_peak": False}  # what the core learns late is no peak here
    config = small(env=IDP, core=str(first), algo=algo, steps=300, settings=settings)
    result = run_training(config, out=tmp_path / "whole")
    assert (result.core, result.core_digest) == (str(first), load_core(first).digest)
    assert read_record(tmp_path / "whole")["core_digest"] == result.core_digest
    with pytest.raises(InterruptedRunError):
        run_training(config, out=tmp_path / "cut", report=interrupt_at(150))
    run_training(config, out=tmp_path / "cut", resume=True)
    assert_same_run(tmp_path / "whole", tmp_path / "cut")
    assert evaluate_subject(load_subject(str(tmp_path / "whole")), episodes=1).mean == result.eval_return_mean
    third = load_core(tmp_path / "whole")
    assert third.policy()(observations(9))[0].shape == (16, 1)
    inner = load_policy(tmp_path / "whole").core.state_dict()
    before = load_core(first).network().state_dict()
    statistics = [name for name in before if name.endswith(("mean", "var", "count"))]
    assert statistics
    assert all(torch.equal(inner[name], before[name]) for name in statistics)
    assert not torch.equal(inner["policy.core.body.0.weight"], before["policy.core.body.0.weight"])


def test_a_frozen_run_stays(tmp_path):
    first = done(tmp_path / "first", core=CORE)
    second = done(tmp_path / "second", core=str(first), settings={"wrap.freeze": {"core": 1.0}})
    before = load_core(first).network().state_dict()
    assert all(torch.equal(before[name], tensor) for name, tensor in load_policy(second).core.state_dict().items())


def test_controls_of_a_run_share_its_statistics_and_no_weights(tmp_path):
    core = load_core(done(tmp_path / "first", core=CORE))
    for control in (core.randomized(0), core.shuffled(0)):
        ours, theirs = core.components["policy"], control.components["policy"]
        for name in ("policy.core.body.0.weight", "policy.core.mean_head.weight", "policy.residual.0.0.weight"):
            assert not torch.equal(ours[name], theirs[name]), name
        assert torch.equal(ours["policy.normalizer.mean"], theirs["policy.normalizer.mean"])
        assert wrap(control, IDP)(observations(9))[0].isfinite().all()


def test_a_run_plays_other_environments_as_a_core(tmp_path):
    run = done(tmp_path / "first", core=CORE)
    own, other = load_subject(str(run)), load_subject(str(run), env=IDP)
    assert (own.env, other.env, other.about["core"]) == (IP, IDP, "first")
    assert other.policy.has_core
    assert set(other.policy.trace(observations(9))) == {"core_input", "core_output"}


def test_the_best_policy_of_a_run_is_a_core_too(tmp_path):
    run = done(tmp_path / "run", steps=300, eval_every=100)
    best, last = load_core(run / "best.safetensors"), load_core(run)
    assert (best.id, load_core(run / "policy.safetensors").digest) == ("run-best", last.digest)
    assert best.digest != last.digest
    expected = load_policy(run, best=True)(observations(4))[0]
    torch.testing.assert_close(wrap(best, IP)(observations(4))[0], expected)
    elsewhere = load_subject(str(run), env=IDP, best=True)
    assert elsewhere.about["core_digest"] == best.digest
    assert load_subject(str(run / "best.safetensors")).about == load_subject(str(run), best=True).about
    around = run_training(small(env=IDP, core=str(run / "best.safetensors")), out=tmp_path / "around")
    assert around.core_digest == best.digest


def test_what_is_not_a_core_says_so(tmp_path):
    run = done(tmp_path / "run")
    with pytest.raises(SettingError, match="member=1 must be 0 to 0 for core run"):
        load_core(run).network(1)
    config = small(steps=200)
    with pytest.raises(InterruptedRunError):
        run_training(config, out=run, resume=True, report=interrupt_at(130))
    with pytest.raises(
        RunDirectoryError, match=r"run .*run is not finished, so it is not a core yet; finish it with resume=True"
    ):
        load_core(run)
    (tmp_path / "empty").mkdir()
    with pytest.raises(ArtifactError, match=r"empty is neither a core's folder nor the directory of a run"):
        load_core(tmp_path / "empty")
    with pytest.raises(UnknownNameError, match="unknown core 'nothing'"):
        load_core("nothing")
    RunDirectory.create(tmp_path / "begun", {}).close()
    with pytest.raises(RunDirectoryError, match="is not finished"):
        load_core(tmp_path / "begun")


def test_a_damaged_run_is_refused(tmp_path):
    run = done(tmp_path / "run")
    for name in ("policy.safetensors", "run.json", "result.json"):
        copy = shutil.copytree(run, tmp_path / name)
        data = bytearray((copy / name).read_bytes())
        data[len(data) // 2] ^= 1
        (copy / name).write_bytes(data)
        with pytest.raises(RunDirectoryError, match=f"{name} is damaged"):
            load_core(copy)


def test_an_environment_that_its_record_names_runs_no_module_unless_the_user_names_it(tmp_path):
    run = tmp_path / "run"
    policy = scratch_policy(Counter(5))
    train(policy, lambda: Counter(5), Budget(episodes=2), eval_episodes=1, out=run)
    assert load_core(run).spec.env_id == "<Counter>"  # its meaning is in the record
    module = tmp_path / "strange_robots.py"
    module.write_text("raise SystemExit('imported')")
    done(tmp_path / "other")
    record = read_json(tmp_path / "other/run.json", dict)
    record["config"]["env"] = "strange_robots:Robot-v0"
    write_json(tmp_path / "other/run.json", record)
    with pytest.raises(EnvironmentContractError, match="which runs the module strange_robots"):
        load_core(tmp_path / "other")


def test_runs_around_runs_have_a_bound_and_are_read_up_to_it(tmp_path):
    run = done(tmp_path / "0", steps=32, settings={})
    bare = {"wrap.residual": 0, "wrap.finetune": False}
    for k in range(MOST_NESTED + 1):
        run = done(tmp_path / str(k + 1), steps=32, core=str(run), settings=bare)
        assert load_policy(run)(observations(4))[0].isfinite().all()
        if k + 1 < MOST_NESTED:
            load_core(run)
    with pytest.raises(RunDirectoryError, match=f"is the last of more than {MOST_NESTED} runs"):
        load_core(run)


def test_a_run_around_a_core_that_holds_its_actions_is_a_core_that_does(tmp_path):
    run = done(tmp_path / "run", env="dm_control/cheetah-run-v0", core="half-cheetah-v1", settings={"wrap.probation": 0})
    assert load_policy(run).hold == 5
    core = load_core(run)
    again = wrap(core, "dm_control/cheetah-run-v0", residual=0)
    assert (core.spec.hold, again.hold) == (5, 5)
    assert_acts_alike(load_policy(run), again, observations(17))


def test_a_run_of_a_users_own_function_says_what_its_numbers_mean(tmp_path):
    run = done(tmp_path / "run", env="tests.envs.own:pendulum")
    assert load_core(run).spec.env_id == "tests.envs.own:pendulum"
    assert done(tmp_path / "next", env=IDP, core=str(run), settings={"wrap.probation": 0})


def test_a_run_that_goes_on_has_no_final_policy_yet(tmp_path):
    run = done(tmp_path / "run")
    directory, _ = RunDirectory.resume(run, Budget(steps=200))
    directory.close()
    for load in (load_policy, load_core, load_subject):
        with pytest.raises(RunDirectoryError, match="finish"):
            load(run)


def test_a_core_is_the_same_whatever_its_folder_is_called(tmp_path):
    run_training(small(), out=tmp_path / "core")
    around = partial(small, IDP, settings={"wrap.probation": 0})
    run_training(around(core=str(tmp_path / "core")), out=tmp_path / "run")
    (tmp_path / "core").rename(tmp_path / "moved")
    more = around(core=str(tmp_path / "moved"), steps=150)
    assert run_training(more, out=tmp_path / "run", resume=True).steps == 150
    other = around(core=CORE, steps=200)
    with pytest.raises(RunDirectoryError, match=r"core is .* there and 'inverted-pendulum-v1' here"):
        run_training(other, out=tmp_path / "run", resume=True)
