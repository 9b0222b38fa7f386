import csv

from experiments import matches


def test_the_pairs_that_match_are_written(tmp_path, capsys):
    arguments = [
        "--env",
        "InvertedDoublePendulum-v5",
        "--env",
        "dm_control/acrobot-swingup-v0",
        "--out",
        str(tmp_path / "m.csv"),
    ]
    assert matches.main(arguments) == 0
    with (tmp_path / "m.csv").open() as file:
        rows = {row["core"]: row for row in csv.DictReader(file)}
    assert {row["target"] for row in rows.values()} == {"InvertedDoublePendulum-v5"}
    assert rows["inverted-pendulum-v1"]["length"] == "0.5"
    assert "dm_control/acrobot-swingup-v0, 0 cores" in capsys.readouterr().out
    assert matches.main(arguments) == 2
    assert "exists" in capsys.readouterr().err
