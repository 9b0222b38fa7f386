import pytest
import torch

from transferkit.errors import RunDirectoryError, RunInUseError
from transferkit.run import EpisodeRow, ModelRow, Result, RunDirectory, check_same, read_table


def row(episode):
    return EpisodeRow(episode, 0, 1.0, 5, 1, 5 * episode, 0.1)


def test_a_start_that_was_killed_before_its_record_is_no_hindrance(tmp_path):
    for name in (".lock", "run.json.tmp"):
        (tmp_path / name).touch()
    RunDirectory.create(tmp_path, {"seed": 1}).close()
    with pytest.raises(RunDirectoryError, match="in use"):
        RunDirectory.create(tmp_path, {"seed": 1})


def test_a_directory_in_use_is_refused(tmp_path):
    with RunDirectory.create(tmp_path / "run", {"a": 1}):
        with pytest.raises(RunDirectoryError, match="in use; continue it with resume=True, or choose another out"):
            RunDirectory.create(tmp_path / "run", {"a": 1})
        with pytest.raises(RunInUseError, match="another process is writing"):
            RunDirectory.resume(tmp_path / "run")
    with RunDirectory.resume(tmp_path / "run")[0] as run:
        assert run.result is None


def test_a_start_that_fails_releases_the_directory(tmp_path, monkeypatch):
    with monkeypatch.context() as patch:
        patch.setattr("transferkit.run.directory.write_json", lambda *_: 1 / 0)
        with pytest.raises(ZeroDivisionError) as error:
            RunDirectory.create(tmp_path / "run", {})
    RunDirectory.create(tmp_path / "run", {}).close()
    assert error.traceback  # which holds the first one


def test_rows_beyond_the_checkpoint_are_cut_because_their_steps_run_again(tmp_path):
    with RunDirectory.create(tmp_path / "run", {}) as run:
        run.append(row(1))
        run.checkpoint({"tensor": torch.arange(2)})
        run.append(row(2))
        run.append(ModelRow(1, *[0.0] * 7))
    with (tmp_path / "run/episodes.csv").open("a") as file:
        file.write("999,half a row that a kill left beh")
    again, state = RunDirectory.resume(tmp_path / "run")
    with again:
        assert state["tensor"].tolist() == [0, 1]
        again.append(row(2))
    assert read_table(tmp_path / "run", EpisodeRow)["episode"].tolist() == [1, 2]
    assert len(read_table(tmp_path / "run", ModelRow)["steps"]) == 0


def test_without_a_checkpoint_every_row_is_cut(tmp_path):
    with RunDirectory.create(tmp_path / "run", {}) as run:
        run.append(row(1))
    again, state = RunDirectory.resume(tmp_path / "run")
    with again:
        again.append(row(1))
    assert state is None
    assert len(read_table(tmp_path / "run", EpisodeRow)["episode"]) == 1


def test_a_finished_run_keeps_its_tables(tmp_path):
    with RunDirectory.create(tmp_path / "run", {}) as run:
        run.append(row(1))
        result = run.finish(Result("ppo", "default-v2", None, None, None, "x", 0, 1, 5, 0.1, 1.0, 0.0, 1.0, 1.0, 1, "run"))
    again, state = RunDirectory.resume(tmp_path / "run")
    with again:
        assert again.result == result
    assert state is None
    assert len(read_table(tmp_path / "run", EpisodeRow)["episode"]) == 1


def test_every_difference_of_two_configurations_is_named(tmp_path):
    recorded = {"seed": 0, "overrides": {"ppo.gamma": 0.9}, "steps": 10, "hidden": [8, 8]}
    check_same(tmp_path, recorded, {**recorded, "hidden": (8, 8)})
    with pytest.raises(RunDirectoryError) as error:
        check_same(tmp_path, recorded, {"seed": 1, "overrides": {"ppo.gamma": 0.8}, "steps": 10, "hidden": [8, 8], "env": "x"})
    assert str(error.value) == (
        f"run {tmp_path} was made with another configuration: env is None there and 'x' here, overrides.ppo.gamma is 0.9 there "
        "and 0.8 here, seed is 0 there and 1 here; resume with its own values, or start anew with another out"
    )


def test_a_difference_of_the_policy_is_named_only_if_it_is_the_only_one(tmp_path):
    recorded = {"env": "a", "policy": {"obs_dim": 4}}
    with pytest.raises(RunDirectoryError, match=r"configuration: policy.obs_dim is 4 there and 11 here; resume"):
        check_same(tmp_path, recorded, {"env": "a", "policy": {"obs_dim": 11}})
    with pytest.raises(RunDirectoryError, match="configuration: env is 'a' there and 'b' here; resume"):
        check_same(tmp_path, recorded, {"env": "b", "policy": {"obs_dim": 11}})
