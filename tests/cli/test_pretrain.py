from tests.cli.commands import run, run_json

FAST = ["--ppo.num-envs", "2", "--ppo.rollout-steps", "64", "--ppo.epochs", "1", "--eval-episodes", "2"]


def test_pretrain_refuses_a_core_below_its_threshold_and_writes_a_good_one(capsys, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    command = ["pretrain", "--env", "InvertedPendulum-v5", "--name", "small", "--steps", "300", "--seeds", "0", *FAST]
    code, _, err = run(capsys, *command, "--threshold", "950")
    assert code == 2
    assert "refused" in err
    assert not (tmp_path / "zoo/small-v1").exists()
    assert "give --eval-every with --best" in run(capsys, *command, "--threshold", "1", "--best")[2]
    longer = [word.replace("300", "400") for word in command]
    code, _, err = run(capsys, *longer, "--threshold", "950")  # members are trained in one go
    assert (code, "steps is 300 there and 400 here" in err, "with another --name" in err) == (2, True, True)
    code, _, err = run(capsys, *command, "--threshold", "950", "--eval-every", "100", "--stop-at", "900")
    assert (code, "--stop-at=900.0 must be at least the threshold 950" in err) == (2, True)
    (tmp_path / "zoo/.unfinished/small-v1").mkdir(parents=True)
    (tmp_path / "zoo/.unfinished/small-v1/card.json").write_text("half of what a killed call")
    line = run_json(capsys, *command, "--threshold", "1")
    assert line["id"] == "small-v1"
    assert [path.name for path in (tmp_path / "zoo").iterdir()] == ["small-v1"]
    assert "verify" not in run(capsys, "zoo", "verify", "zoo/small-v1", "--rollout")[2]
