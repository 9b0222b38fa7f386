"""Each command, run for real."""

import json
import signal
import subprocess
import sys
import time

import matplotlib.pyplot as plt
import pytest

from transferkit.cli.main import main

CORE = "inverted-pendulum-v1"
FAST = ["--ppo.num-envs", "2", "--ppo.rollout-steps", "64", "--ppo.epochs", "1", "--eval-episodes", "2"]


def run(capsys, *arguments):
    code = main(list(arguments))
    output = capsys.readouterr()
    return code, output.out, output.err


def run_json(capsys, *arguments):
    code, out, err = run(capsys, *arguments, "--json")
    assert code == 0, err
    return json.loads(out)


def test_zoo(capsys):
    rows = run_json(capsys, "zoo", "list")
    row = next(row for row in rows if row["id"] == "inverted-pendulum-v1")
    keys = {"id", "source_env", "obs_dim", "act_dim", "parts", "members", "score_mean", "score_low", "score_high", "threshold"}
    assert set(row) == keys
    assert (row["source_env"], row["obs_dim"], row["act_dim"], row["members"]) == ("InvertedPendulum-v5", 4, 1, 5)
    assert run_json(capsys, "zoo", "show", "inverted-pendulum-v1")["source"]["env_id"] == "InvertedPendulum-v5"
    assert run_json(capsys, "zoo", "verify", "--all")[0]["probe"] < 1e-5
    assert "inverted-pendulum-v1" in run(capsys, "zoo", "list")[1]


def test_envs(capsys):
    assert "dm_control/walker-walk-v0" in run_json(capsys, "envs", "list")
    assert run_json(capsys, "envs", "show", "Hopper-v5")["time_step"] == pytest.approx(0.008)
    assert "drive.slide_x" in run(capsys, "envs", "show", "InvertedPendulum-v5")[1]


def test_train_and_eval(capsys, tmp_path):
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


@pytest.mark.parametrize("algo", ["dyna-ddpg", "dyna-ppo"])
def test_train_with_a_model_and_plot(capsys, tmp_path, algo):
    out = str(tmp_path / "run")
    small = ["--dyna.updates-per-step", "1", "--dyna.batch-size", "32", "--dyna.model-updates", "5", "--dyna.ppo-updates", "1"]
    small += ["--dyna.model-share", "0.5"] if algo == "dyna-ddpg" else []
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
    assert (result["preset"], result["episodes"]) == ("paper", 3)


def test_pretrain_refuses_a_core_below_its_threshold_and_writes_a_good_one(capsys, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    command = ["pretrain", "--env", "InvertedPendulum-v5", "--name", "small", "--steps", "300", "--seeds", "0", *FAST]
    code, _, err = run(capsys, *command, "--threshold", "950")
    assert code == 2
    assert "refused" in err
    assert not (tmp_path / "zoo/small-v1").exists()
    code, _, err = run(capsys, *command, "--threshold", "950", "--eval-every", "100", "--stop-at", "900")
    assert (code, "below the threshold 950; pass a higher --stop-at" in err) == (2, True)
    line = run_json(capsys, *command, "--threshold", "1")
    assert line["id"] == "small-v1"
    assert "verify" not in run(capsys, "zoo", "verify", "zoo/small-v1", "--rollout")[2]


def test_doctor(capsys):
    report = run_json(capsys, "doctor")
    assert {"versions", "problems"} <= set(report)


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        (["trian"], "did you mean train"),
        (["zoo", "show", "inverted-pendulun-v1"], "did you mean inverted-pendulum-v1"),
        (["zoo", "verify"], "--all"),
        (["envs", "show", "Hoper-v5"], "did you mean Hopper-v5"),
        (["train", "--env", "CartPole-v1", "--steps", "10"], "Discrete"),
        (["train", "--env", "Hopper-v5"], "no budget given"),
        (["train", "--env", "Hopper-v5", "--steps", "many"], "Error parsing --steps"),
        (["train", "--env", "Hopper-v5", "--stepz", "9"], "Unrecognized options: --stepz"),
        (["train", "--steps", "9"], "--env"),
        (["train", "--env", "Hopper-v5", "--steps", "0"], "must be a positive number"),
        (["train", "--env", "Hopper-v5", "--episodes", "-3"], "must be a positive number"),
        (["train", "--env", "Hopper-v5", "--steps", "9", "--preset", "papr"], "default or paper"),
        (["train", "--env", "Hopper-v5", "--steps", "9", "--device", "cuda:77"], "--device cpu"),
        (["train", "--env", "Hopper-v5", "--steps", "9", "--core", "nope"], "unknown core 'nope'"),
        (["train", "--env", "Hopper-v5", "--steps", "9", "--core", CORE, "--wrap.freeze", "cor", "1"], "parts are"),
        (["train", "--env", "Hopper-v5", "--steps", "9", "--core", CORE, "--member", "9"], "0 to 4"),
        (["eval", "/nonexistent"], "run.json"),
    ],
)  # fmt: skip
def test_mistakes_get_one_line_and_write_nothing(capsys, tmp_path, monkeypatch, arguments, message):
    monkeypatch.chdir(tmp_path)
    code, out, err = run(capsys, *arguments)
    assert code == 2
    assert message in err
    assert err.strip().count("\n") == 0
    assert out == ""
    assert list(tmp_path.iterdir()) == []


def python(*code):
    return subprocess.run([sys.executable, *code], capture_output=True, text=True, check=True)


def test_a_closed_pipe_is_no_error():
    process = subprocess.Popen([sys.executable, "-m", "transferkit", "zoo", "list"], stdout=-1, stderr=-1, text=True)
    process.stdout.close()
    process.stdout = None
    assert process.communicate()[1] == ""


def test_import_and_listing_load_nothing_heavy():
    heavy = "{'torch', 'rsl_rl', 'mujoco', 'dm_control', 'gymnasium'} & set(sys.modules)"
    assert python("-c", f"import sys, transferkit; print({heavy})").stdout.strip() == "set()"
    listing = f"import sys; from transferkit.cli.main import main; main(['zoo', 'list']); print({heavy})"
    assert python("-c", listing).stdout.strip().endswith("set()")


@pytest.mark.parametrize("how", [signal.SIGKILL, signal.SIGINT])
def test_a_killed_command_goes_on_to_the_same_numbers(tmp_path, how):
    def command(out, *more):
        arguments = ["train", "--env", "InvertedPendulum-v5", "--steps", "6000", "--checkpoint-seconds", "0.1"]
        return [sys.executable, "-m", "transferkit", *arguments, "--out", str(tmp_path / out), "--json", *more]

    whole = json.loads(subprocess.run(command("whole"), capture_output=True, text=True, check=True).stdout)
    process = subprocess.Popen(command("cut"), stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True)
    while not (tmp_path / "cut/checkpoint.safetensors").exists():
        assert process.poll() is None
        time.sleep(0.02)
    process.send_signal(how)
    err = process.communicate()[1]
    if how == signal.SIGINT:
        assert process.returncode == 130
        assert "Traceback" not in err
        assert "--resume" in err.splitlines()[-1]
    cut = json.loads(subprocess.run(command("cut", "--resume"), capture_output=True, text=True, check=True).stdout)
    same = [key for key in whole if key not in ("seconds", "run_dir")]
    assert {key: cut[key] for key in same} == {key: whole[key] for key in same}
    assert (tmp_path / "cut/policy.safetensors").read_bytes() == (tmp_path / "whole/policy.safetensors").read_bytes()
