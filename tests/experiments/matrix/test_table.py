from dataclasses import replace

import pytest

from experiments.matrix.table import COLUMNS, Row, ambiguity, read_rows, write_rows
from transferkit.errors import RunDirectoryError

ROW = Row("a1", "", 0, "Hopper-v5", "scratch", "ppo", "ppo", "default-v2", '{"ppo.gamma": 0.9}', 3, None, 150, None, 0, 2)
FINISHED = replace(ROW, episodes=4, steps=150, seconds=1.5, eval_return_mean=0.1 + 0.2, eval_return_std=1.0)
FAILED = replace(ROW, id="b2", seed=4, error_kind="DivergedError", error='a "quoted", long one')


def test_rows_are_what_they_were(tmp_path):
    write_rows(tmp_path / "rows.csv", [FINISHED, FAILED])
    again = read_rows(tmp_path / "rows.csv")
    assert repr(again) == repr([FINISHED, FAILED])  # NaN differs from itself
    assert [row.finished for row in again] == [True, False]


@pytest.mark.parametrize(
    ("old", "new", "message"),
    [
        ("eval_return_mean", "return", "does not have the columns"),
        (",seed,", ",", "does not have the columns"),
        ("0.30000000000000004", "nan", "line 2, is not a run that ended"),
        ("0.30000000000000004", "", "line 2, is not a run that ended"),
        ("0.30000000000000004", "good", "line 2, is not a run that ended"),
        ("0.30000000000000004", "1,2", "line 2, is not a run that ended"),
        (",150,", ",1.5,", "line 2, is not a run that ended"),
        ("Hopper-v5", "", "line 2, is not a run that ended"),
        ('"{""ppo.gamma"": 0.9}"', "[]", "line 2, is not a run that ended"),
    ],
    ids=["renamed column", "missing column", "NaN", "no score", "word", "two cells", "fraction", "no target", "overrides"],
)
def test_another_table_is_refused_in_one_line(tmp_path, old, new, message):
    path = tmp_path / "rows.csv"
    write_rows(path, [FINISHED])
    path.write_text(path.read_text().replace(old, new))
    with pytest.raises(RunDirectoryError, match=message):
        read_rows(path)


def test_what_is_not_text_is_refused(tmp_path):
    (tmp_path / "rows.csv").write_bytes(b"\xff\x00")
    with pytest.raises(RunDirectoryError, match="is not a table of runs"):
        read_rows(tmp_path / "rows.csv")


@pytest.mark.parametrize(
    ("change", "what"),
    [
        ({"seed": 9, "core": "c"}, ""),
        ({"overrides": "{}"}, "runs of ppo on Hopper-v5 with 2 settings"),
        ({"overrides": "{}", "trainer": "other"}, ""),
        ({"budget_steps": 151}, "runs of ppo on Hopper-v5 with 2 budgets"),
        ({"preset": "default-v1"}, "runs of ppo on Hopper-v5 with 2 settings"),
        ({"eval_episodes": 3}, "runs of ppo on Hopper-v5 with 2 settings"),
    ],
)
def test_one_name_stands_for_one_setting_and_one_budget(change, what):
    assert ambiguity([ROW, replace(ROW, **change)]) == what


def test_columns_are_the_fields():
    assert COLUMNS[:3] == ("id", "core", "member")
    assert len(set(COLUMNS)) == len(COLUMNS)
