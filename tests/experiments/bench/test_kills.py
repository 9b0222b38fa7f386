import json
import subprocess
import sys

import pytest

from experiments.bench.kills.campaign import campaign
from experiments.bench.kills.jobs import Job
from transferkit.files import write_json


def found(job, tmp_path, kills=12):
    record = {"seed": 0, "jobs": {}, "problems": []}
    campaign([job], kills, record, tmp_path / "out.json")
    return record["jobs"][job.name], record["problems"]


def careful(folder):
    write_json(folder / "result.json", {"a": 1})


def careless(folder):
    (folder / "result.json").write_text('{"a": 1}')


def forgetful(folder):
    write_json(folder / "first.json", {"seen": (folder / "result.json").exists() or (folder / "first.json").exists()})
    write_json(folder / "result.json", {"a": 1})


def stubborn(folder):
    (folder / "started").mkdir()
    write_json(folder / "result.json", {"a": 1})


def losing(folder):
    (folder / "a.json").unlink(missing_ok=True)
    write_json(folder / "a.json", {"a": 1})
    (folder / "a.json").unlink()
    write_json(folder / "a.json", {"a": 1})


def messy(folder):
    if (folder / "half.tmp").exists():
        write_json(folder / "more.json", {})
    (folder / "half.tmp").touch()
    (folder / "half.tmp").rename(folder / "whole.tmp")


def test_atomic_writes_survive_every_kill(tmp_path):
    row, problems = found(Job("careful", careful, 1), tmp_path)
    assert problems == []
    assert row["kills"] >= 12
    # before an old temporary file is removed, before the new one is opened, empty, half, whole, before it is renamed
    assert sorted(row["met"]) == [1, 2, 3, 4, 5, 6]
    assert row["before_operation"] + row["at_random"] == row["kills"]
    assert row["resumed"] == row["trials"]


@pytest.mark.parametrize(
    ("run", "kind", "words"),
    [
        (careless, "other", "half-written result.json"),
        (forgetful, "differing", "first.json"),
        (stubborn, "other", "does not go on: exit code 1: FileExistsError"),
        (losing, "lost", "a.json is gone"),
        (messy, "other", "more.json is left over"),
    ],
)
def test_a_job_that_does_not_survive_is_found(run, kind, words, tmp_path):
    row, problems = found(Job(run.__name__, run, 1), tmp_path)
    assert row[kind] > 0
    assert any(words in problem for problem in problems)


def test_a_campaign_goes_on(tmp_path):
    record = {"seed": 0, "jobs": {}, "problems": []}
    for kills in (3, 9):
        campaign([Job("careful", careful, 1)], kills, record, tmp_path / "out.json")
        record = json.loads((tmp_path / "out.json").read_text())
        assert kills <= record["jobs"]["careful"]["kills"] < kills + 4


def test_training_and_recording_go_on_to_the_same_bits(tmp_path):
    command = [sys.executable, "-m", "experiments.bench", "kills", "--kills", "4", "--out", str(tmp_path / "kills.json")]
    done = subprocess.run([*command, "--jobs", "ppo", "record", "matrix"], capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stdout + done.stderr
    assert "at a random time" in done.stdout
