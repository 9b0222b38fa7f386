import signal
import subprocess
import sys
import time

import matplotlib.pyplot as plt
import pytest

from tests.cli.commands import run, run_json

CORE = "inverted-pendulum-v1"
SMALL = {
    "dyna-ddpg": ["--dyna.updates-per-step", "1", "--dyna.batch-size", "32", "--dyna.model-share", "0.5"],
    "dyna-ppo": ["--dyna-ppo.updates", "1"],
}
FAST = ["--ppo.num-envs", "2", "--ppo.rollout-steps", "64", "--ppo.epochs", "1", "--eval-episodes", "2"]


def test_train_and_eval(capsys, tmp_path, caplog):
    out = str(tmp_path / "run")
    command = ["train", "--env", "InvertedDoublePendulum-v5", "--core", "inverted-pendulum-v1", "--steps", "200", *FAST]
    result = run_json(capsys, *command, "--out", out)
    assert result["steps"] == 200
    assert result["run_dir"] == out
    assert result["core"] == "inverted-pendulum-v1"
    assert list((tmp_path / "run/tensorboard").iterdir())
    again = run_json(capsys, "eval", out, "--episodes", "2")
    assert again["return_mean"] == result["eval_return_mean"]
    code, _, err = run(capsys, *command, "--out", out)
    assert code == 2
    assert "in use" in err
    code, _, err = run(capsys, *command, "--out", out, "--seed", "1", "--resume")
    assert code == 2
    assert "seed is 0 there and 1 here" in err
    assert run_json(capsys, *command, "--out", out, "--resume") == result
    run_json(capsys, *command, "--out", str(tmp_path / "new"), "--resume")
    assert f"{tmp_path / 'new'} has no run to go on with: one starts there" in caplog.messages
    assert "other files than a run's; choose another --out" in run(capsys, *command, "--out", str(tmp_path), "--resume")[2]


def test_the_best_policy_is_evaluated_and_exported_as_it_was(capsys, tmp_path):
    out, last = str(tmp_path / "run"), str(tmp_path / "last")
    command = ["train", "--env", "InvertedPendulum-v5", "--steps", "2000", "--seed", "1", *FAST]
    best = run_json(capsys, *command, "--eval-every", "200", "--out", out)["best"]
    means = [float(line.split(",")[3]) for line in (tmp_path / "run/evaluations.csv").read_text().splitlines()[1:]]
    assert best["return_mean"] == max(means) > means[-1]
    assert run_json(capsys, "eval", out, "--best", "--episodes", "2")["return_mean"] == max(means)
    assert run_json(capsys, "eval", out, "--episodes", "2")["return_mean"] == means[-1]
    for name in ("best", "last"):
        flags = ["--best"] if name == "best" else []
        run_json(capsys, "export", out, *flags, "--out", str(tmp_path / f"{name}.onnx"))
    assert (tmp_path / "best.onnx").read_bytes() != (tmp_path / "last.onnx").read_bytes()
    assert run_json(capsys, *command, "--out", last)["best"] is None
    assert "has one policy" in run(capsys, "eval", last, "--best")[2]
    assert "--trust-core has no effect" in run(capsys, *command, "--trust-core")[2]


@pytest.mark.parametrize("algo", ["dyna-ddpg", "dyna-ppo"])
def test_train_with_a_model_and_plot(capsys, tmp_path, algo):
    out = str(tmp_path / "run")
    small = ["--model.updates", "5", *SMALL[algo]]
    command = ["train", "--env", "InvertedDoublePendulum-v5", "--core", CORE, "--algo", algo, "--steps", "510", "--out", out]
    result = run_json(capsys, *command, *small, "--eval-episodes", "2")
    assert (result["algo"], result["steps"]) == (algo, 510)
    assert (tmp_path / "run/model.csv").read_text().count("\n") == 2
    picture = run_json(capsys, "plot", out)["picture"]
    assert plt.imread(picture).std() > 0.01
    code, _, err = run(capsys, "plot", str(tmp_path))
    assert code == 2
    assert "run.json" in err


def test_the_paper_preset(capsys, tmp_path):
    command = ["train", "--preset", "paper", "--env", "Hopper-v5", "--core", "inverted-pendulum-v1", "--episodes", "3"]
    result = run_json(capsys, *command, "--eval-episodes", "1", "--out", str(tmp_path / "run"))
    assert (result["preset"], result["episodes"]) == ("paper-v1", 3)


def test_a_command_that_is_killed_and_interrupted_goes_on_to_the_same_numbers(capsys, tmp_path):
    short = ["--steps", "6000", "--eval-episodes", "2", "--checkpoint-seconds", "0.1"]
    train = ["train", "--env", "InvertedPendulum-v5", *short]
    whole, cut = tmp_path / "whole", tmp_path / "cut"
    expected = run_json(capsys, *train, "--out", whole)
    command = [sys.executable, "-m", "transferkit", *train, "--out", str(cut), "--resume", "--json"]
    for how, code in ((signal.SIGKILL, -signal.SIGKILL), (signal.SIGINT, 130)):
        before = written(cut)
        process = subprocess.Popen(command, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True)
        while written(cut) == before:
            assert process.poll() is None
            time.sleep(0.02)
        process.send_signal(how)
        err = process.communicate()[1]
        assert process.returncode == code
    assert "Traceback" not in err
    assert err.splitlines()[-1].endswith("the same call goes on with --resume")
    found = run_json(capsys, *train, "--out", cut, "--resume")
    assert found | {"seconds": 0, "run_dir": ""} == expected | {"seconds": 0, "run_dir": ""}
    assert (cut / "policy.safetensors").read_bytes() == (whole / "policy.safetensors").read_bytes()


def written(run):
    """When the last checkpoint was."""
    checkpoint = run / "checkpoint.safetensors"
    return checkpoint.stat().st_mtime_ns if checkpoint.exists() else None


def test_a_match_that_was_edited_since_is_no_match_to_go_on_with(capsys, tmp_path):
    core, twin, file = "inverted-pendulum-v1", "dm_control/cartpole-balance-v0", tmp_path / "match.yaml"
    run(capsys, "match", core, twin, "--yaml", str(file))
    command = ["train", "--core", core, "--env", twin, "--match", str(file), *FAST, "--out", str(tmp_path / "run")]
    first = run_json(capsys, *command, "--steps", "100")
    text = file.read_text()
    file.write_text(text.replace("drive.slide_x: {drive.slide_x: ", "drive.slide_x: {drive.slide_x: -"))
    code, _, err = run(capsys, *command, "--steps", "100", "--resume")
    assert code == 2
    assert f"the match {file} was edited since the run began; restore it, or give another --out" in err
    file.write_text(f"# again\n{text}")
    assert run_json(capsys, *command, "--steps", "100", "--resume") == first


def test_more_budget_later_and_a_finished_run_as_a_core(capsys, tmp_path):
    out = str(tmp_path / "first")
    command = ["train", "--env", "InvertedPendulum-v5", *FAST]
    first = run_json(capsys, *command, "--steps", "100", "--out", out)
    code, text, _ = run(capsys, *command, "--steps", "200", "--out", out, "--resume")
    assert code == 0
    assert f"before budget 2   return {first['eval_return_mean']} after {first['episodes']} episodes, 100 steps" in text
    both = run_json(capsys, *command, "--steps", "200", "--out", out, "--resume")
    assert (both["steps"], [before["steps"] for before in both["earlier"]]) == (200, [100])
    code, _, err = run(capsys, *command, "--steps", "100", "--out", out, "--resume")
    assert code == 2
    assert "is finished and has spent 200 steps, so --steps 100 is no more budget" in err
    assert err.strip().endswith("give more --steps to train on, or --steps 200 for its result")
    tuned = run_json(capsys, *command, "--core", out, "--steps", "100", "--out", str(tmp_path / "second"))
    assert (tuned["core"], tuned["member"]) == (out, 0)
