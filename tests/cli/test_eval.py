import json
import sys

import pytest

from tests.cli.commands import refusal, run, run_json
from transferkit import run_training
from transferkit.cli import progress
from transferkit.config import TrainConfig, with_settings
from transferkit.files import write_json

MODULE = """
import gymnasium
from gymnasium.envs.mujoco.inverted_pendulum_v5 import InvertedPendulumEnv

gymnasium.register("Planted-v0", InvertedPendulumEnv, max_episode_steps=50)
"""


@pytest.fixture(scope="module")
def finished(tmp_path_factory):
    out = tmp_path_factory.mktemp("eval") / "run"
    config = TrainConfig("InvertedPendulum-v5", steps=20, eval_episodes=1)
    run_training(with_settings(config, {"network.hidden": [4]}), out=out)
    return out


def test_a_module_of_a_file_is_run_only_if_the_user_names_it(finished, tmp_path, monkeypatch, capsys):
    (tmp_path / "planted_robots.py").write_text(MODULE)
    monkeypatch.syspath_prepend(tmp_path)
    record = json.loads((finished / "run.json").read_text())
    write_json(finished / "run.json", {**record, "config": {**record["config"], "env": "planted_robots:Planted-v0"}})
    said = refusal(capsys, "eval", finished, "--episodes", 1)
    assert "which runs the module planted_robots; if you trust that, name it yourself: --env planted_robots:Planted-v0" in said
    assert "planted_robots" not in sys.modules
    answer = run_json(capsys, "eval", finished, "--episodes", 1, "--env", "planted_robots:Planted-v0")
    assert (answer["returns"], len(answer["lengths"])) == ([answer["return_mean"]], 1)
    assert answer["return_mean"] <= 50
    write_json(finished / "run.json", record)


def test_an_evaluation_says_how_far_it_is_and_ends_where_the_user_says(finished, monkeypatch, capsys):
    monkeypatch.setattr(progress, "EVALUATION_SECONDS", 0.0)
    code, out, err = run(capsys, "eval", finished, "--episodes", 2, "--max-episode-steps", 3)
    assert (code, out.split(",")[0]) == (0, "return 3.0")
    assert err.splitlines()[-1] == "evaluation: 2 of 2 episodes, 0 s left, 6 steps"
    assert "--max-episode-steps=0 must be at least 1" in refusal(capsys, "eval", finished, "--max-episode-steps", 0)
