import errno
import json
import os
from dataclasses import replace

import pytest
import torch

from transferkit import load_core
from transferkit.config import TrainConfig
from transferkit.errors import ConfigError, Interrupted, NotFiniteError, RunDirectoryError
from transferkit.evaluation import ZeroPolicy, evaluate
from transferkit.run import RunDirectory, Streams
from transferkit.run.directory import read_table
from transferkit.run.files import load_state, save_state, write_atomically
from transferkit.run.session import Session
from transferkit.trained import load_policy
from transferkit.transfer import run_training

SMALL = TrainConfig("InvertedPendulum-v5", steps=1001, eval_episodes=2, checkpoint_seconds=0.0, eval_every=400)


def small(**options):
    ppo = replace(SMALL.ppo, num_envs=4, rollout_steps=128, epochs=2)
    return replace(SMALL, **{"ppo": ppo, **options})


def test_streams_are_named_independent_and_repeatable():
    one, same, other = Streams(1), Streams(1), Streams(2)
    assert one.integer("a", 0, 1) == same.integer("a", 0, 1)
    seeds = {one.integer("a", 0, 1), one.integer("a", 1, 0), one.integer("b", 0, 1), other.integer("a", 0, 1)}
    assert len(seeds) == 4
    draws = [torch.rand(3, generator=stream.torch("a")) for stream in (one, same, other)]
    assert torch.equal(draws[0], draws[1])
    assert not torch.equal(draws[0], draws[2])


def test_states_make_the_round_trip(tmp_path):
    state = {"a": torch.arange(3), "n": [1, 2.5, None, "x"], "nested": {0: {"t": torch.ones(2, 2)}, "k": []}}
    save_state(tmp_path / "s", state)
    loaded = load_state(tmp_path / "s")
    assert torch.equal(loaded["a"], state["a"])
    assert torch.equal(loaded["nested"][0]["t"], state["nested"][0]["t"])
    assert loaded["n"] == state["n"]
    assert loaded["nested"]["k"] == []


def test_a_start_that_was_killed_before_its_record_is_no_hindrance(tmp_path):
    for name in (".lock", "run.json.tmp"):
        (tmp_path / name).touch()
    RunDirectory.create(tmp_path, {"seed": 1}).close()
    with pytest.raises(RunDirectoryError, match="in use"):
        RunDirectory.create(tmp_path, {"seed": 1})


@pytest.mark.parametrize("keep", [0, 5, 40, -1])
def test_a_cut_state_file_is_refused(tmp_path, keep):
    save_state(tmp_path / "s", {"a": torch.arange(100)})
    data = (tmp_path / "s").read_bytes()
    (tmp_path / "s").write_bytes(data[:keep])
    with pytest.raises(RunDirectoryError, match="cannot be read"):
        load_state(tmp_path / "s")


def test_a_full_disk_leaves_the_old_file(tmp_path, monkeypatch):
    path = tmp_path / "file"
    write_atomically(path, b"old")

    def full(_):
        raise OSError(errno.ENOSPC, os.strerror(errno.ENOSPC))

    monkeypatch.setattr(os, "fsync", full)
    with pytest.raises(RunDirectoryError, match=r"No space left on device.*--resume"):
        write_atomically(path, b"new")
    assert [p.name for p in tmp_path.iterdir()] == ["file"]
    assert path.read_bytes() == b"old"


def test_a_directory_in_use_is_refused(tmp_path):
    run = RunDirectory.create(tmp_path / "run", {"a": 1})
    with pytest.raises(RunDirectoryError, match=r"in use.*--resume"):
        RunDirectory.create(tmp_path / "run", {"a": 1})
    with pytest.raises(RunDirectoryError, match="another process"):
        RunDirectory.resume(tmp_path / "run", {"a": 1})
    run.close()
    with pytest.raises(RunDirectoryError, match="a is 1 there and 2 here"):
        RunDirectory.resume(tmp_path / "run", {"a": 2})


@pytest.mark.parametrize(("num_envs", "budget"), [(1, {"episodes": 7}), (8, {"episodes": 7}), (8, {"steps": 1001})])
def test_budgets_are_exact(tmp_path, num_envs, budget):
    ppo = replace(SMALL.ppo, num_envs=num_envs, rollout_steps=64, epochs=1)
    result = run_training(small(**{"ppo": ppo, "steps": None, **budget}), out=tmp_path / "run")
    rows = read_table(tmp_path / "run", "episodes")
    assert result.episodes == len(rows)
    assert [row["episode"] for row in rows] == list(range(1, len(rows) + 1))
    if "episodes" in budget:
        assert len(rows) == 7
        assert rows[-1]["steps"] == result.steps
    else:
        assert result.steps == 1001
    ended = sum(row["length"] for row in rows)
    assert ended <= result.steps < ended + 1000 * num_envs


def numbers(path):
    """Everything a run wrote but its times."""
    tables = [
        [{k: v for k, v in row.items() if k != "seconds"} for row in read_table(path, table)]
        for table in ("episodes", "evaluations")
    ]
    result = {k: v for k, v in json.loads((path / "result.json").read_text()).items() if k not in ("seconds", "run_dir")}
    return tables, result, load_policy(path).state_dict()


def assert_same(a, b):
    assert numbers(a)[:2] == numbers(b)[:2]
    for name, tensor in numbers(a)[2].items():
        assert torch.equal(tensor, numbers(b)[2][name]), name


@pytest.mark.parametrize(
    ("core", "stop_at", "rollout", "steps"),
    [
        (None, None, 128, 384),
        ("inverted-pendulum-v1", None, 128, 384),
        (None, None, 16, 384),  # most rollouts are longer
        (None, 1.0, 128, 512),  # at the very evaluation that is good enough
    ],
)
def test_an_interrupted_run_goes_on_to_the_bit(tmp_path, monkeypatch, core, stop_at, rollout, steps):
    ppo = replace(SMALL.ppo, rollout_steps=rollout, epochs=2)
    config = small(core=core, env="InvertedDoublePendulum-v5", stop_at=stop_at, ppo=ppo)
    run_training(config, out=tmp_path / "whole")
    after_update = Session.after_update

    def interrupted(self, metrics, state):
        self._interrupted = self.spent.steps >= steps
        after_update(self, metrics, state)

    monkeypatch.setattr(Session, "after_update", interrupted)
    with pytest.raises(Interrupted, match="--resume"):
        run_training(config, out=tmp_path / "cut")
    monkeypatch.undo()
    (tmp_path / "cut/episodes.csv").open("a").write("999,half a row that a kill left beh")
    run_training(config, out=tmp_path / "cut", resume=True)
    assert run_training(config, out=tmp_path / "cut", resume=True).run_dir == str(tmp_path / "cut")  # finished: no more work
    assert_same(tmp_path / "whole", tmp_path / "cut")


def test_training_stops_at_an_evaluation_that_is_good_enough(tmp_path):
    with pytest.raises(ConfigError, match=r"stop_at=3 .*--eval-every"):
        small(eval_every=0, stop_at=3.0)
    result = run_training(small(stop_at=1.0), out=tmp_path / "run")
    steps = [int(row["steps"]) for row in read_table(tmp_path / "run", "evaluations")]
    assert steps == [0, 512]
    assert result.steps == 512
    whole = run_training(small(stop_at=1e6), out=tmp_path / "whole")
    assert whole.steps == 1001


def test_a_run_killed_before_its_first_checkpoint_starts_again(tmp_path):
    config = small(checkpoint_seconds=1e9)
    run_training(config, out=tmp_path / "whole")
    (tmp_path / "cut").mkdir()
    for name in ("run.json", "episodes.csv"):
        (tmp_path / "cut" / name).write_bytes((tmp_path / "whole" / name).read_bytes())
    (tmp_path / "cut/evaluations.csv").touch()
    run_training(config, out=tmp_path / "cut", resume=True)
    assert_same(tmp_path / "whole", tmp_path / "cut")


def test_nan_in_a_loss_stops_and_keeps_the_last_good_checkpoint(tmp_path):
    config = small(
        ppo=replace(SMALL.ppo, num_envs=4, rollout_steps=128, learning_rate=0.99, schedule="fixed", max_grad_norm=None)
    )
    good = None

    def report(spent, _):
        nonlocal good
        if spent.steps == 128:
            good = (tmp_path / "run/checkpoint.safetensors").exists()

    after_update = Session.after_update

    def poisoned(self, metrics, state):
        if self.spent.steps > 128:
            metrics = {**metrics, "surrogate": float("nan")}
        after_update(self, metrics, state)

    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(Session, "after_update", poisoned)
        with pytest.raises(NotFiniteError, match="surrogate became nan at environment step 256"):
            run_training(config, out=tmp_path / "run", report=report)
    state = load_state(tmp_path / "run/checkpoint.safetensors")
    assert state["session"]["spent"][1] == 128


@pytest.mark.parametrize(("frozen_share", "moves"), [(1.0, False), (0.5, True), (0.0, True)])
def test_a_frozen_core_stays_and_an_unfrozen_one_learns(tmp_path, frozen_share, moves):
    wrap = replace(SMALL.wrap, freeze={"core": frozen_share})
    ppo = replace(SMALL.ppo, rollout="steps", rollout_steps=64, epochs=2)
    run_training(small(core="inverted-pendulum-v1", wrap=wrap, ppo=ppo), out=tmp_path / "run")
    trained = load_policy(tmp_path / "run").state_dict()
    before = load_core("inverted-pendulum-v1").network(0).state_dict()
    names = ("body.0.weight", "body.2.weight")
    assert [not torch.equal(trained[f"core.{name}"], before[name]) for name in names] == [moves] * 2
    assert trained["output_adapter.weight"].abs().sum() > 0


def test_evaluation_episodes_depend_on_their_number_alone():
    whole = evaluate(ZeroPolicy(1), "InvertedDoublePendulum-v5", episodes=12, seed=3)
    assert evaluate(ZeroPolicy(1), "InvertedDoublePendulum-v5", episodes=5, seed=3).returns == whole.returns[:5]
    assert evaluate(ZeroPolicy(1), "InvertedDoublePendulum-v5", episodes=5, seed=4).returns != whole.returns[:5]
    assert whole.row()["return_low"] < whole.mean < whole.row()["return_high"]
