import pytest

from tests.cli.commands import run, run_json


def test_envs(capsys):
    assert "dm_control/walker-walk-v0" in run_json(capsys, "envs", "list")
    assert run_json(capsys, "envs", "show", "Hopper-v5")["time_step"] == pytest.approx(0.008)
    assert "drive.slide_x" in run(capsys, "envs", "show", "InvertedPendulum-v5")[1]
    assert run_json(capsys, "envs", "show", "dm_control/pendulum-swingup-v0")["mirror"]["action"] == {
        "index": [0],
        "sign": [-1],
    }


def test_what_is_deprecated_in_the_suites_own_files_is_not_the_users_matter(capsys, caplog):
    for env in ("dm_control/cheetah-run-v0", "HalfCheetah-v5?vary.gear=0.7"):
        run(capsys, "envs", "show", env)
    assert not caplog.messages
