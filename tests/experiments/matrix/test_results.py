import shutil
from dataclasses import replace

import pytest

from experiments.matrix.__main__ import main
from experiments.matrix.grid_toml import load_cells
from experiments.matrix.results import KNOWN, TABLE, collect, read_results
from experiments.matrix.runner import run_cell
from experiments.matrix.table import write_rows
from transferkit.errors import RunDirectoryError


def known(root, name, rows):
    (root / KNOWN).mkdir(parents=True, exist_ok=True)
    write_rows(root / KNOWN / name, rows)


def test_a_table_stands_for_runs_whose_folders_are_gone(grid, tmp_path, capsys):
    path, out = grid(), tmp_path / "out"
    assert run_cell(load_cells(path)[0], tmp_path / "lost", "test").error == ""
    (row,) = collect(tmp_path / "lost")
    (out / KNOWN).mkdir(parents=True)
    shutil.copy(tmp_path / "lost" / TABLE, out / KNOWN / "earlier.csv")
    assert repr(read_results(out).rows) == repr([row])
    assert main([str(path), "--out", str(out), "--dry-run"]) == 0
    assert "7 runs, 6 to do" in capsys.readouterr().out
    known(out, "other.csv", [replace(row, eval_return_mean=1.5)])
    assert main([str(path), "--out", str(out), "--dry-run"]) == 2
    assert f"with another score than before it ({row.eval_return_mean} and 1.5)" in capsys.readouterr().err


def test_what_finished_stays_whatever_failed(results, tmp_path):
    row = read_results(results).finished[0]
    failed = replace(row, error_kind="DivergedError", error="made up")
    for names in (("a.csv", "b.csv"), ("b.csv", "a.csv")):
        for name, one in zip(names, (row, failed), strict=True):
            known(tmp_path, name, [one])
        assert [one.finished for one in read_results(tmp_path).rows] == [True]
    known(tmp_path, "a.csv", [failed])
    known(tmp_path, "b.csv", [failed])
    assert len(read_results(tmp_path).failed) == 1


def test_a_file_named_known_is_refused(tmp_path):
    (tmp_path / KNOWN).touch()
    with pytest.raises(RunDirectoryError, match="known is a file; make it a folder"):
        read_results(tmp_path)


def test_evaluations_are_a_table_by_run(copy):
    rows = collect(copy)
    lines = (copy / "evaluations.csv").read_text().splitlines()
    assert lines[0] == "id,steps,episodes,seconds,return_mean,core"
    trained = [row for row in rows if row.trainer]
    assert len(lines) == 1 + 3 * len(trained)  # before, after 128 steps, and at the end
    assert {line.partition(",")[0] for line in lines[1:]} == {row.id for row in trained}


@pytest.mark.parametrize(
    ("changed", "message"),
    [
        ({"arm": "scratch"}, "a run of the arm scratch with core"),
        ({"core": ""}, "a run of the arm transfer with core none"),
        ({"id": "f" * 16, "eval_return_mean": 0.0}, "has the run transfer on .* with seed 0 as .* and as"),
    ],
)
def test_rows_that_contradict_what_they_are_of_are_refused(results, tmp_path, changed, message):
    row = next(row for row in read_results(results).finished if row.arm == "transfer")
    known(tmp_path, "a.csv", [row, replace(row, **changed)] if "id" in changed else [replace(row, **changed)])
    with pytest.raises(RunDirectoryError, match=message):
        read_results(tmp_path)
