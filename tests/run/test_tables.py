from transferkit.run import TABLES, EpisodeRow, EvaluationRow, RunDirectory, read_table


def test_columns_are_the_fields_of_a_row():
    assert EpisodeRow.columns() == ("episode", "env_index", "return", "length", "terminated", "steps", "seconds")
    assert {kind.table for kind in TABLES} == {"episodes", "evaluations", "model"}


def test_rows_make_the_round_trip(tmp_path):
    row = EpisodeRow(1, 2, -0.1, 30, 1, 400, 5.125)
    with RunDirectory.create(tmp_path / "run", {}) as run:
        run.append(row)
        run.append(EpisodeRow(2, 0, 1 / 3, 7, 0, 407, 6.0))
    assert (tmp_path / "run/episodes.csv").read_text().splitlines()[:2] == [
        "episode,env_index,return,length,terminated,steps,seconds",
        "1,2,-0.1,30,1,400,5.125",
    ]
    rows = read_table(tmp_path / "run", EpisodeRow)
    assert rows["return"].tolist() == [-0.1, 1 / 3]
    assert [values[0] for values in rows.values()] == row.values()
    assert len(read_table(tmp_path / "run", EvaluationRow)["steps"]) == 0
