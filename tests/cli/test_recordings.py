"""Policies as ONNX files, and each command of recordings run for real."""

import json

import gymnasium
import numpy as np
import onnxruntime
import pytest

from transferkit.cli.main import main
from transferkit.deploy import export_onnx, load_subject
from transferkit.errors import ConfigError
from transferkit.evaluation import evaluate


def test_an_exported_policy_plays_the_bare_environment(tmp_path):
    subject = load_subject("inverted-pendulum-v1")
    assert export_onnx(subject, tmp_path / "policy.onnx") < 1e-4
    session = onnxruntime.InferenceSession(tmp_path / "policy.onnx")
    about = session.get_modelmeta().custom_metadata_map
    assert json.loads(about["observation_names"])[0] == "slide_x_position"
    assert json.loads(about["action_high"]) == [3.0]
    env = gymnasium.make("InvertedPendulum-v5")  # not ours: controls in newtons, float64 observations
    observation, _ = env.reset(seed=1)
    total, done = 0.0, False
    while not done:
        (action,) = session.run(["action"], {"observation": observation[None].astype(np.float32)})
        assert np.abs(action).max() <= 3.0
        observation, reward, terminated, truncated, _ = env.step(action[0])
        total, done = total + reward, terminated or truncated
    assert total == 1000
    assert evaluate(subject.policy, "InvertedPendulum-v5", episodes=1).mean == 1000
    with pytest.raises(ConfigError, match="exists"):
        export_onnx(subject, tmp_path / "policy.onnx")


def run(capsys, *arguments):
    code = main(list(map(str, arguments)))
    output = capsys.readouterr()
    return code, output.out, output.err


def test_commands(capsys, tmp_path):
    file, out = tmp_path / "run.mcap", tmp_path / "run"
    train = ["train", "--env", "InvertedDoublePendulum-v5", "--core", "inverted-pendulum-v1", "--algo", "dyna-ddpg"]
    small = ["--steps", 200, "--eval-episodes", 1, "--dyna.updates-per-step", 1, "--eval-every", 100, "--record", "every=2"]
    assert run(capsys, *train, *small, "--out", out)[0] == 0
    assert {path.name for path in (out / "recordings").iterdir()} == {"step_0.mcap", "step_200.mcap"}
    code, text, _ = run(capsys, "record", out, "--episodes", 2, "--out", file, "--json")
    assert code == 0
    assert len(json.loads(text)["episodes"]) == 2
    assert run(capsys, "replay", file, "--check")[1].endswith("reproduced to the bit\n")
    assert run(capsys, "plot", file)[0] == 0
    assert (tmp_path / "run.png").stat().st_size > 10_000
    file.write_bytes(file.read_bytes()[:-20])
    assert "was cut" in run(capsys, "recover", file)[1]
    assert run(capsys, "replay", tmp_path / "run.recovered.mcap", "--check")[0] == 0
    assert run(capsys, *train, *small[:6], "--experience", file, "--out", tmp_path / "again")[0] == 0


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        (("record", "nothing-v1", "--out", "x.mcap"), "unknown core 'nothing-v1'"),
        (("record", "inverted-pendulum-v1", "--episodes", "0", "--out", "x.mcap"), "must be at least 1"),
        (("replay", "nothing.mcap"), "cannot read nothing.mcap"),
        (("recover", "nothing.mcap"), "cannot read nothing.mcap"),
        (("plot", "nothing.mcap"), "cannot read nothing.mcap"),
        (("export", "a", "b", "--out", "x.onnx"), "export them one by one"),
        (("train", "--env", "Hopper-v5", "--steps", "9", "--record", "always"), "must be every=N"),
        (("train", "--env", "Hopper-v5", "--steps", "9", "--experience", "x.mcap"), "pass --algo dyna-ddpg"),
    ],
)
def test_mistakes_are_one_line(capsys, tmp_path, monkeypatch, arguments, message):
    monkeypatch.chdir(tmp_path)
    code, _, err = run(capsys, *arguments)
    assert code == 2
    assert message in err
    assert err.count("\n") == 1
    assert not list(tmp_path.iterdir())
