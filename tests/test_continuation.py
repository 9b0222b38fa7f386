"""Finished runs that are given more budget."""

import shutil
from dataclasses import asdict, replace

import pytest

from experiments.bench.forks import start, wait
from experiments.bench.kills.points import Counter, Watch
from tests.runs import assert_same_run, interrupt_at
from tests.toys import Counter as Counting
from transferkit import load_policy, run_training, scratch_policy, train
from transferkit.budget import Budget
from transferkit.config import TrainConfig, with_settings
from transferkit.errors import InterruptedRunError, RunDirectoryError
from transferkit.evaluation import evaluate
from transferkit.files import read_json, write_json
from transferkit.plots import draw_run
from transferkit.run import EpisodeRow, EvaluationRow, Record, Result, finished_result, load_state, read_record, read_table
from transferkit.subject import evaluate_subject, load_subject, load_value
from transferkit.trainers.dyna.agent import Agent

IDP = "InvertedDoublePendulum-v5"
SETTINGS = {
    "ppo": {"ppo.num_envs": 2, "ppo.rollout": "steps", "ppo.rollout_steps": 32, "ppo.epochs": 1, "network.hidden": [8]},
    "dyna-ddpg": {
        "network.hidden": [8],
        "dyna.updates_per_step": 1,
        "dyna.batch_size": 8,
        "dyna.model_share": 0.5,
        "model.hidden": [8],
    },
    "dyna-ppo": {"network.hidden": [8], "model.updates": 2, "model.hidden": [8], "model.every": 40, "dyna_ppo.updates": 1},
}


def small(algo="ppo", **options):
    given = {"env": IDP, "steps": 130, "eval_every": 60, "eval_episodes": 2, "checkpoint_seconds": 0.0}
    return with_settings(TrainConfig(**{**given, **options}, algo=algo), SETTINGS[algo])


def more(config, **budget):
    return replace(config, **{"episodes": None, "steps": None, "seconds": None, **budget})


@pytest.mark.parametrize("algo", SETTINGS)
def test_a_run_with_more_budget_goes_on_to_the_bit_and_its_result_says_both(tmp_path, algo):
    config = small(algo)
    first = run_training(config, out=tmp_path / "whole")
    before = load_policy(tmp_path / "whole").state_dict()
    shutil.copytree(tmp_path / "whole", tmp_path / "cut")
    longer = more(config, steps=330)
    both = run_training(longer, out=tmp_path / "whole", resume=True)
    with pytest.raises(InterruptedRunError):
        run_training(longer, out=tmp_path / "cut", resume=True, report=interrupt_at(200))
    assert finished_result(tmp_path / "cut") is None
    run_training(longer, out=tmp_path / "cut", resume=True)
    assert_same_run(tmp_path / "whole", tmp_path / "cut")

    assert (first.steps, first.earlier, both.steps) == (130, (), 330)
    (earlier,) = both.earlier
    assert asdict(earlier) == {name: getattr(first, name) for name in asdict(earlier)}
    scores = evaluate(load_policy(tmp_path / "whole"), IDP, episodes=2)
    assert both.eval_return_mean == scores.mean
    assert any((before[name] != tensor).any() for name, tensor in load_policy(tmp_path / "whole").state_dict().items())
    assert {130.0, 330.0} < {*read_table(tmp_path / "whole", EvaluationRow)["steps"]}
    assert len(read_table(tmp_path / "whole", EpisodeRow)["episode"]) == both.episodes
    record = read_json(tmp_path / "whole/run.json", Record)
    (continuation,) = record.continuations
    assert (record.config["steps"], continuation.budget, continuation.after) == (130, {"steps": 330}, earlier)
    assert continuation.command
    assert TrainConfig.from_json(read_record(tmp_path / "whole")) == config


def test_a_continued_run_is_read_and_continued_like_any_other(tmp_path):
    run, config = tmp_path / "run", small()
    run_training(config, out=run)
    run_training(more(config, steps=200), out=run, resume=True)
    last = run_training(more(config, episodes=60), out=run, resume=True)
    assert (last.episodes, [one.steps for one in last.earlier]) == (60, [130, 200])
    assert run_training(more(config, episodes=60), out=run, resume=True) == last == read_json(run / "result.json", Result)
    assert evaluate_subject(load_subject(str(run)), episodes=2).mean == last.eval_return_mean
    assert load_value(run, load_policy(run)) is not None
    draw_run(run, tmp_path / "curves.png")
    with pytest.raises(RunDirectoryError) as error:  # its first budget, and its second one
        run_training(config, out=run, resume=True)
    assert str(error.value) == (
        f"run {run} is finished and has spent {last.steps} steps, so steps=130 is no more budget; "
        "give more steps to train on, or episodes=60 for its result"
    )
    for budget in ({"steps": 10_000, "episodes": 60}, {"seconds": 1e-6}, {"steps": last.steps}):
        with pytest.raises(RunDirectoryError, match="is no more budget"):
            run_training(more(config, **budget), out=run, resume=True)
    with pytest.raises(RunDirectoryError, match="seed is 0 there and 1 here; resume"):
        run_training(more(config, steps=10_000, seed=1), out=run, resume=True)
    assert finished_result(run) == last


def test_a_run_that_goes_on_has_its_new_budget_only(tmp_path):
    config = small()
    run_training(config, out=tmp_path / "run")
    with pytest.raises(InterruptedRunError):
        run_training(more(config, steps=330), out=tmp_path / "run", resume=True, report=interrupt_at(200))
    for steps in (130, 400):
        with pytest.raises(RunDirectoryError, match=f"steps is 330 there and {steps} here"):
            run_training(more(config, steps=steps), out=tmp_path / "run", resume=True)


def test_what_cannot_go_on_says_so_and_stays_finished(tmp_path):
    done, good = tmp_path / "done", tmp_path / "good"
    run_training(small(), out=done)
    state = load_state(done / "checkpoint.safetensors")
    assert state["session"]["spent"][1] == state["session"]["evaluated"] == 130
    (done / "checkpoint.safetensors").unlink()
    with pytest.raises(RunDirectoryError, match=rf"no checkpoint of its end.*; train on from it with core={done} into"):
        run_training(small(steps=330), out=done, resume=True)
    run_training(small(stop_at=1.0), out=good)
    with pytest.raises(RunDirectoryError, match=r"has reached stop_at=1, which ends it under any budget"):
        run_training(small(stop_at=1.0, steps=330), out=good, resume=True)
    assert finished_result(done).steps == 130
    assert finished_result(good) is not None


def test_python_continues_a_policy_in_place_in_an_environment_of_its_own(tmp_path):
    for steps in (64, 128):
        policy = scratch_policy(Counting(5))
        result = train(policy, lambda: Counting(5), Budget(steps=steps), eval_episodes=1, out=tmp_path / "run", resume=True)
    assert [result.steps, *(one.steps for one in result.earlier)] == [128, 64]
    assert all((load_policy(tmp_path / "run").state_dict()[name] == value).all() for name, value in policy.state_dict().items())


def test_schedules_follow_the_new_budget_from_the_first_step(tmp_path, monkeypatch):
    config, seen = small("dyna-ddpg", steps=150, eval_every=0), []
    run_training(config, out=tmp_path / "run")
    explore = Agent.explore
    monkeypatch.setattr(Agent, "explore", lambda agent, x: seen.append(agent.anchor.state()["progress"]) or explore(agent, x))
    run_training(more(config, steps=300), out=tmp_path / "run", resume=True)
    assert (seen[0], len(seen)) == (0.5, 150)


def test_a_kill_before_any_file_operation_of_a_continuation_loses_nothing(tmp_path):
    """In each of many processes one operation later; whenever it is, the run is finished with the old budget, or goes on."""
    config, place = small(steps=40, eval_every=0, eval_episodes=1, checkpoint_seconds=1e9), tmp_path / "place"
    longer = more(config, steps=70)
    first = run_training(config, out=place)
    shutil.copytree(place, tmp_path / "done")
    whole = run_training(longer, out=place, resume=True)
    place.rename(tmp_path / "whole")
    fatal, killed = 0, True
    while killed:
        fatal += 1
        shutil.copytree(tmp_path / "done", place)

        def work(fatal=fatal):
            Watch(place, tmp_path / "journal", Counter(), fatal).start()
            run_training(longer, out=place, resume=True)

        code = wait(start(work, tmp_path / "said"))
        killed = code < 0
        assert killed or code == 0, (tmp_path / "said").read_text()
        found, record = finished_result(place), read_json(place / "run.json", Record)
        if not record.continuations:
            assert found == first
        else:
            assert found in (None, replace(whole, seconds=found.seconds if found else 0.0))
            assert record.continuations[0].after.eval_return_mean == first.eval_return_mean
        if (place / "result.json").exists():
            read_table(place, EpisodeRow)
        run_training(longer, out=place, resume=True)
        assert_same_run(tmp_path / "whole", place)
        shutil.rmtree(place)
    assert fatal > 20


def test_a_result_of_before_that_a_kill_left_behind_does_not_count(tmp_path):
    config, run = small(steps=40), tmp_path / "run"
    run_training(config, out=run)
    old = (run / "result.json").read_bytes()
    with pytest.raises(InterruptedRunError):
        run_training(more(config, steps=330), out=run, resume=True, report=interrupt_at(100))
    (run / "result.json").write_bytes(old)
    assert finished_result(run) is None
    assert run_training(more(config, steps=330), out=run, resume=True).steps == 330


def test_a_changed_record_is_refused(tmp_path):
    config, run = small(steps=40), tmp_path / "run"
    run_training(config, out=run)
    run_training(more(config, steps=70), out=run, resume=True)
    record = read_json(run / "run.json", dict)
    write_json(run / "run.json", {**record, "continuations": [{"budget": {"steps": "70"}}]})
    with pytest.raises(RunDirectoryError, match=r"run\.json is damaged"):
        run_training(more(config, steps=70), out=run, resume=True)
