import pytest

from transferkit.errors import RunDirectoryError
from transferkit.run import TABLES, EpisodeRow, EvaluationRow, Result, RunDirectory, read_table


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


def test_a_torn_last_row_is_left_out_and_any_other_damage_is_one_line(tmp_path):
    with RunDirectory.create(tmp_path / "run", {}) as run:
        run.append(EpisodeRow(1, 0, 2.5, 30, 1, 30, 1.0))
    path, whole = EpisodeRow.file(tmp_path / "run"), read_table(tmp_path / "run", EpisodeRow)
    text = path.read_text()
    path.write_text(text + "2,0,7")
    assert read_table(tmp_path / "run", EpisodeRow) == whole
    for damaged in (text + "2,0,7\n", text.replace("2.5", "nan"), text.replace("2.5", "x"), text.replace("return", "x"), ""):
        path.write_text(damaged)
        with pytest.raises(RunDirectoryError, match=r"episodes\.csv is damaged"):
            read_table(tmp_path / "run", EpisodeRow)


def test_a_table_of_before_lacks_its_last_columns(tmp_path):
    with RunDirectory.create(tmp_path / "run", {}) as run:
        run.append(EvaluationRow(1, 30, 1.0, 2.5, 0.5, 2.0, 3.0, 20, core=1))
    assert read_table(tmp_path / "run", EvaluationRow)["core"].tolist() == [1]
    path = EvaluationRow.file(tmp_path / "run")
    path.write_text("".join(line.rpartition(",")[0] + "\n" for line in path.read_text().splitlines()))
    before = read_table(tmp_path / "run", EvaluationRow)
    assert (before["n"].tolist(), before["core"].tolist()) == ([20], [0])
    path.write_text("".join(line.rpartition(",")[0] + "\n" for line in path.read_text().splitlines()))
    with pytest.raises(RunDirectoryError, match=r"evaluations\.csv is damaged"):
        read_table(tmp_path / "run", EvaluationRow)


def test_a_table_of_before_goes_on_as_it_began(tmp_path):
    row = EvaluationRow(1, 30, 1.0, 2.5, 0.5, 2.0, 3.0, 20, core=1)
    with RunDirectory.create(tmp_path / "run", {}) as run:
        run.append(row)
    path = EvaluationRow.file(tmp_path / "run")
    path.write_text("".join(line.rpartition(",")[0] + "\n" for line in path.read_text().splitlines()))
    with RunDirectory(tmp_path / "run") as run:
        run.append(row)
    table = read_table(tmp_path / "run", EvaluationRow)
    assert (table["n"].tolist(), table["core"].tolist()) == ([20, 20], [0, 0])


def test_the_table_of_a_finished_run_has_a_checksum(tmp_path):
    with RunDirectory.create(tmp_path / "run", {}) as run:
        run.append(EpisodeRow(1, 0, 2.5, 30, 1, 30, 1.0))
        run.finish(Result("ppo", "default-v2", None, None, None, "x", 0, 1, 30, 1.0, 2.5, 0.0, 2.5, 2.5, 1, "run"))
    path = EpisodeRow.file(tmp_path / "run")
    path.write_text(path.read_text().replace("2.5", "9.5"))
    with pytest.raises(RunDirectoryError, match="it was changed: its checksum does not fit"):
        read_table(tmp_path / "run", EpisodeRow)
