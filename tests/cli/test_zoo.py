from tests.cli.commands import run, run_json


def test_zoo(capsys):
    rows = run_json(capsys, "zoo", "list")
    row = next(row for row in rows if row["id"] == "inverted-pendulum-v1")
    keys = {"id", "source_env", "obs_dim", "act_dim", "parts", "members", "score_mean", "score_low", "score_high", "threshold"}
    assert set(row) == keys
    assert (row["source_env"], row["obs_dim"], row["act_dim"], row["members"]) == ("InvertedPendulum-v5", 4, 1, 5)
    assert run_json(capsys, "zoo", "show", "inverted-pendulum-v1")["source"]["env_id"] == "InvertedPendulum-v5"
    card = run(capsys, "zoo", "show", "hopper-v1")[1]
    assert "| Walker2d-v5 | 973.8 | 769.8 to 1361.5 | 98.6 | 98.6 (zero-action) |" in card  # as the study says
    assert "Not with every member above every control: HalfCheetah-v5," in card
    assert "Robot: 2 slides and 4 hinges, 3 actuators, 15.8 kg." in card
    untrained = {one["target"]: one for one in run_json(capsys, "zoo", "show", "hopper-v1")["untrained"]}
    assert len(untrained["Walker2d-v5"]["members"]) == 3
    without = run(capsys, "zoo", "verify", "hopper-v1", "--env", "Hopper-v5")[2]
    assert "--env Hopper-v5 has no effect without --rollout; add it, or leave --env out" in without
    assert run_json(capsys, "zoo", "verify", "--all")[0]["probe"] < 1e-5
    assert "inverted-pendulum-v1" in run(capsys, "zoo", "list")[1]
