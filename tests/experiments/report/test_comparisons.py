from dataclasses import replace

import numpy as np
import pytest

from experiments.matrix.cell_folder import CELLS, ERROR, SPEED
from experiments.matrix.grid_toml import load_cells
from experiments.matrix.runner import run_cell
from experiments.matrix.table import Row
from experiments.report.comparisons import compare
from experiments.report.matrix import load_matrix
from experiments.report.tables import arm_rows, curve_rows, verdict_rows
from experiments.report.verdict import paired
from transferkit.errors import RunDirectoryError
from transferkit.files import write_json


def made_up(arm, member, seed, value, kind=""):
    core = "" if arm == "scratch" else "c"
    identity = (f"{arm}{member}{seed}", core, member, "target", arm, "ppo", "ppo", "default-v2", "{}", seed)
    row = Row(*identity, None, 150, None, 0, 20, eval_return_mean=value)
    return replace(row, error_kind=kind, eval_return_mean=np.nan) if kind else row


def fail(root, cell, kind):
    """Turn a finished cell into one that failed."""
    (root / CELLS / cell.id / SPEED).unlink(missing_ok=True)
    write_json(root / CELLS / cell.id / ERROR, {"kind": kind, "message": "made up"})


def test_members_are_paired_with_themselves_and_missing_ones_are_missing():
    effect = {0: 0.0, 1: 5.0, 2: 9.0}
    rows = [made_up("transfer", m, s, effect[m]) for m in (0, 1, 2) for s in range(4)]
    rows += [made_up("random", m, s, effect[m]) for m in (0, 1) for s in range(4)] + [made_up("random", 2, 1, effect[2])]
    rows += [made_up("scratch", 0, s, 1.0) for s in range(4)]
    (group,) = compare(rows)
    assert group.scores["transfer"].shape == group.scores["random"].shape == (3, 4)
    assert group.scores["scratch"].shape == (1, 4)
    both = paired(group.scores, ("transfer", "random"))
    np.testing.assert_array_equal(both["transfer"] - both["random"], np.zeros((3, 1)))


def test_a_diverged_run_counts_as_the_worst_one():
    rows = [made_up("transfer", 0, s, 7.0 + s) for s in range(3)]
    rows += [made_up("scratch", 0, 0, 3.0), made_up("scratch", 0, 2, 0.0, kind="DivergedError")]
    (group,) = compare(rows)
    np.testing.assert_array_equal(group.scores["scratch"], [[3.0, np.nan, 3.0]])
    assert group.verdict.scratch.mean == 5.0
    assert "scratch 1" in group.verdict.reason
    row = arm_rows(group)[1]
    assert (row["n"], row["failed"], row["mean"]) == (2, 1, 3.0)


def test_a_core_whose_every_run_fails_has_a_verdict(copy):
    for cell in load_cells(copy / "grid.toml"):
        if cell.arm == "transfer":
            fail(copy, cell, "DivergedError")
    verdicts = verdict_rows(load_matrix(copy).groups)
    assert [row["core"] for row in verdicts] == ["inverted-pendulum-v1"] * 2
    for row in verdicts:
        assert "Diverged runs, which count as the worst run of the comparison: transfer 2." in row["reason"]
        assert row["transfer_minus_scratch"] <= 0


def test_failed_runs_are_told_apart_and_censored(copy):
    cells = [cell for cell in load_cells(copy / "grid.toml") if cell.config.env == "InvertedPendulum-v5"]
    cell = next(cell for cell in cells if cell.arm == "transfer")
    reached = {}
    for kind in ("DivergedError", "RunDirectoryError"):
        fail(copy, cell, kind)
        (group,) = (g for g in load_matrix(copy).groups if g.target == "InvertedPendulum-v5" and g.core)
        reached[kind] = curve_rows(group)[0]["never_reached"]
        assert np.isnan(group.scores["transfer"][0, 0]) == (kind == "RunDirectoryError")
        assert ("left out: transfer 1." in group.verdict.reason) == (kind == "RunDirectoryError")
    assert reached == {"DivergedError": 1, "RunDirectoryError": 0}


@pytest.mark.parametrize(
    ("old", "new", "what"),
    [
        ("steps = 256", "steps = 257", "budgets"),
        ("[[part]]\n\n[[part]]", '[[part]]\ntrainer = [{ set = { "ppo.gamma" = 0.8 } }]\n\n[[part]]', "settings"),
    ],
    ids=["budgets", "settings"],
)
def test_runs_of_two_settings_under_one_name_are_refused(copy, old, new, what):
    grid = copy / "grid.toml"
    grid.write_text(grid.read_text().replace(old, new))
    cell = next(cell for cell in load_cells(grid) if cell.arm == "scratch")
    assert run_cell(cell, copy, "the command").error == ""
    with pytest.raises(RunDirectoryError, match=f"holds runs of ppo on InvertedDoublePendulum-v5 with 2 {what}"):
        load_matrix(copy)
