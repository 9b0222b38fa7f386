from tests.cli.commands import run, run_json


def test_zoo(capsys):
    rows = run_json(capsys, "zoo", "list")
    row = next(row for row in rows if row["id"] == "inverted-pendulum-v1")
    keys = {"id", "source_env", "obs_dim", "act_dim", "parts", "members", "score_mean", "score_low", "score_high", "threshold"}
    assert set(row) == keys
    assert (row["source_env"], row["obs_dim"], row["act_dim"], row["members"]) == ("InvertedPendulum-v5", 4, 1, 5)
    assert run_json(capsys, "zoo", "show", "inverted-pendulum-v1")["source"]["env_id"] == "InvertedPendulum-v5"
    assert run_json(capsys, "zoo", "verify", "--all")[0]["probe"] < 1e-5
    assert "inverted-pendulum-v1" in run(capsys, "zoo", "list")[1]
