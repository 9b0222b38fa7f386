"""The report of a small real matrix, its tables, and its page in a real browser."""

import csv
import itertools
import shutil
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest
from playwright.sync_api import sync_playwright

from experiments.matrix.cell_folder import CELLS, SET_ASIDE, finished, problems, set_damaged_aside
from experiments.matrix.grid_toml import load_cells
from experiments.report.__main__ import main
from experiments.report.comparisons import Group, load_matrix
from experiments.report.curves import Arm, running_mean
from experiments.report.tables import arm_rows, curve_rows, verdict_rows
from experiments.report.write import report
from experiments.matrix.table import KNOWN, collect
from experiments.matrix.runner import run_cell
from experiments.report.verdict import paired
from transferkit.errors import RunDirectoryError

GRID = """
steps = 256
cores = ["inverted-pendulum-v1"]
targets = ["InvertedDoublePendulum-v5", "InvertedPendulum-v5"]
arms = ["transfer", "scratch", "zero-action"]
seeds = "0-1"
eval_episodes = 2
eval_every = 128

[[part]]

[[part]]
targets = ["InvertedPendulum-v5"]
arms = ["scratch"]
seeds = [0]
trainer = [{ name = "a second", algo = "ppo", set = { "ppo.gamma" = 0.9 } }]
"""


@pytest.fixture(scope="module")
def results(tmp_path_factory):
    root = tmp_path_factory.mktemp("matrix")
    (root / "grid.toml").write_text(GRID)
    for cell in load_cells(root / "grid.toml"):
        assert run_cell(cell, root, "the command").error == ""
    return root


@pytest.fixture(scope="module")
def page(results):
    command = [sys.executable, "-m", "experiments.report", str(results), "--out", str(results / "report.html")]
    subprocess.run(command, check=True, capture_output=True, timeout=120)
    return results / "report.html"


def test_committed_rows_give_the_same_tables_without_curves(page, results, tmp_path):
    (tmp_path / KNOWN).mkdir()
    shutil.copy(results / "report_files" / "runs.csv", tmp_path / KNOWN)
    command = [sys.executable, "-m", "experiments.report", str(tmp_path), "--out", str(tmp_path / "rows.html")]
    subprocess.run(command, check=True, capture_output=True, timeout=120)
    for name in ("runs", "arms", "verdicts", "aggregates", "paper_measures"):
        assert read(tmp_path / "rows_files" / f"{name}.csv") == read(results / "report_files" / f"{name}.csv")
    assert not list((tmp_path / "rows_files").glob("curves*"))


def read(path):
    with path.open() as file:
        return list(csv.DictReader(file))


def test_tables_hold_every_run_and_agree_with_them(page, results):
    folder = results / "report_files"
    assert len(read(folder / "runs.csv")) == 11
    verdicts = read(folder / "verdicts.csv")
    assert [row["target"] for row in verdicts] == ["InvertedDoublePendulum-v5", "InvertedPendulum-v5"]
    assert [row["own_task"] for row in verdicts] == ["False", "True"]
    assert ["this very task" in row["reason"] for row in verdicts] == [False, True]
    for verdict in verdicts:
        here = [row for row in read(folder / "runs.csv") if row["target"] == verdict["target"] and row["trainer"] == "ppo"]
        means = {
            arm: np.mean([float(r["eval_return_mean"]) for r in here if r["arm"] == arm]) for arm in ("transfer", "scratch")
        }
        assert float(verdict["transfer_minus_scratch"]) == pytest.approx(means["transfer"] - means["scratch"])
        assert verdict["verdict"] != "transfer"  # three of its arms were not run
    runs = [r for r in read(folder / "runs.csv") if r["arm"] == "transfer" and r["target"] == "InvertedPendulum-v5"]
    arms = [r for r in read(folder / "arms.csv") if r["arm"] == "transfer" and r["target"] == "InvertedPendulum-v5"]
    assert float(arms[0]["mean"]) == pytest.approx(sum(float(r["eval_return_mean"]) for r in runs) / 2)
    measures = [r for r in read(folder / "curves.csv") if r["target"] == "InvertedPendulum-v5"]
    assert [row["arm"] for row in measures] == ["transfer", "scratch"]
    assert float(measures[0]["before_training"]) > 900 > float(measures[1]["before_training"])  # it is the core's own task
    assert {row["arm"]: row["targets"] for row in read(folder / "aggregates.csv")} == {"transfer": "2", "scratch": "2"}
    assert {path.suffix for path in folder.iterdir()} == {".csv", ".png", ".svg"}


def test_a_click_on_a_cell_shows_it(page):
    chromium = shutil.which("chromium") or shutil.which("google-chrome")
    assert chromium, "no browser; apt-get install chromium"
    with sync_playwright() as playwright:
        browser = playwright.chromium.launch(executable_path=chromium, args=["--no-sandbox"])
        tab = browser.new_page(viewport={"width": 420, "height": 900}, offline=True)
        errors = []
        tab.on("pageerror", lambda error: errors.append(error))  # noqa: PLW0108 - playwright sets attributes on it
        tab.goto(page.as_uri())
        tab.wait_for_selector("#heat-0 .nsewdrag")
        box = tab.locator("#heat-0 .nsewdrag").bounding_box()
        for share, target in ((0.75, "InvertedPendulum-v5"), (0.25, "InvertedDoublePendulum-v5")):
            tab.mouse.click(box["x"] + share * box["width"], box["y"] + box["height"] / 2)
            tab.wait_for_function(f"document.querySelector('.cell:not([hidden]) h3').textContent.includes(' {target}')")
            tab.evaluate("window.scrollTo(0, 0)")
        shown = tab.locator(".cell:not([hidden])")
        assert shown.locator(".verdict").count() == 1
        assert shown.locator(".curves .scatterlayer .trace").count() >= 2
        shown.locator(".kind").select_option("evaluations")
        shown.locator(".axis").select_option("steps")
        tab.wait_for_function("document.querySelector('.cell:not([hidden]) .xtitle').textContent === 'environment steps'")
        assert not errors
        browser.close()


def test_damaged_runs_enter_no_table_and_run_again(results, tmp_path):
    root = tmp_path / "copy"
    shutil.copytree(results, root)
    with_episodes = (path for path in sorted((root / CELLS).glob("*/run/episodes.csv")) if path.read_text().count("\n") > 3)
    short, forged, cut, *more = itertools.islice(with_episodes, 6)
    short.write_text(short.read_text()[:40])
    (forged.parent / "result.json").write_text((forged.parent / "result.json").read_text().replace("seconds", "second"))
    cell = cut.parents[1] / "cell.json"
    cell.write_text(cell.read_text().replace('"seed": ', '"seed": 7'))
    (more[0].parents[1] / "cell.json").unlink()
    (more[1].parent / "evaluations.csv").write_text("".join((more[1].parent / "evaluations.csv").open().readlines()[:-1]))
    (more[2].parent / "run.json").write_text("{}")
    matrix_of = load_matrix(root)
    assert len(matrix_of.rows) == 11 - 6
    assert len(matrix_of.damaged) == 6
    lines = set_damaged_aside(root, problems(root))
    assert len(lines) == 6
    assert len(list((root / SET_ASIDE).iterdir())) == 6
    todo = [c for c in load_cells(root / "grid.toml") if not finished(root, c).exists()]
    assert len(todo) == 6
    assert [run_cell(cell, root, "the command").error for cell in todo] == [""] * 6
    assert len(collect(root)) == 11


@pytest.mark.parametrize(
    ("name", "change", "what"),
    [
        ("run/policy.safetensors", lambda data: data[:-100], "run/policy.safetensors cannot be read"),
        ("run/policy.safetensors", lambda _: None, "policy.safetensors is missing"),
        ("run/run.json", lambda _: None, "run.json is missing"),
        ("run/episodes.csv", lambda data: data.replace(b"return", b"reward"), "episodes.csv has no return"),
        ("run/result.json", lambda data: data.replace(b"steps", b"step"), "result.json has no steps"),
        ("run/result.json", lambda data: data[:9], "run/result.json is damaged (Unterminated string"),
        ("cell.json", lambda data: data.replace(b'"arm"', b'"arms"'), "cell.json has no arm"),
        ("cell.json", lambda _: None, "it holds no cell.json"),
        ("cell.json", lambda data: data.replace(b'"seed": 0', b'"seed": 1', 1), "cell.json describes another run"),
        ("run/evaluations.csv", lambda data: data.replace(b",n\n", b",m\n"), "evaluations.csv has no n"),
        (
            "run/result.json",
            lambda data: data.replace(b'"eval_episodes": 2', b'"eval_episodes": 3'),
            "evaluations.csv does not",
        ),
        ("run/episodes.csv", lambda data: data.replace(b"\n1,", b"\nnan,", 1), "episodes.csv has a number that is not finite"),
        ("run/run.json", lambda data: data.replace(b'"versions": {', b'"versions": [], "v": {'), "AttributeError"),
    ],
)
def test_damage_is_named_by_its_file(results, tmp_path, name, change, what):
    cell = next(cell for cell in load_cells(results / "grid.toml") if cell.arm == "scratch")
    where = tmp_path / CELLS / cell.id
    shutil.copytree(results / CELLS / cell.id, where)
    assert problems(tmp_path) == {}
    data = change((where / name).read_bytes())
    (where / name).unlink()
    if data is not None:
        (where / name).write_bytes(data)
    assert problems(tmp_path)[where].startswith(what)


def test_a_core_whose_every_run_fails_has_a_verdict(results, tmp_path):
    root = tmp_path / "copy"
    shutil.copytree(results, root)
    for cell in load_cells(root / "grid.toml"):
        if cell.arm == "transfer":
            (root / CELLS / cell.id / "run" / "result.json").unlink()
            (root / CELLS / cell.id / "error.txt").write_text("DivergedError: made up")
    verdicts = verdict_rows(load_matrix(root))
    assert [row["core"] for row in verdicts] == ["inverted-pendulum-v1"] * 2
    for row in verdicts:
        assert "Diverged runs, which count as the worst run of the comparison: transfer 2." in row["reason"]
        assert row["transfer_minus_scratch"] <= 0


def test_failed_runs_are_told_apart_and_censored(results, tmp_path):
    root = tmp_path / "copy"
    shutil.copytree(results, root)
    cells = [cell for cell in load_cells(root / "grid.toml") if cell.target == "InvertedPendulum-v5" and cell.arm == "transfer"]
    (root / CELLS / cells[0].id / "run" / "result.json").unlink()
    error = root / CELLS / cells[0].id / "error.txt"
    reached = {}
    for text in ("DivergedError: made up", "RunDirectoryError: no space left"):
        error.write_text(text)
        (group,) = (g for g in load_matrix(root).groups if g.target == "InvertedPendulum-v5" and g.core)
        reached[text[0]] = curve_rows(group)[0]["never_reached"]
        assert np.isnan(group.scores["transfer"][0, 0]) == text.startswith("Run")
        assert ("left out: transfer 1." in group.verdict.reason) == text.startswith("Run")
    assert reached == {"D": 1, "R": 0}


def test_a_report_replaces_what_an_earlier_one_left(page, results, tmp_path):
    (tmp_path / "mine_files").mkdir()
    for name in ("curves_Hopper-v5.png", "curves.csv", "notes.txt"):
        (tmp_path / "mine_files" / name).touch()
    (tmp_path / KNOWN).mkdir()
    shutil.copy(results / "report_files" / "runs.csv", tmp_path / KNOWN)
    report(tmp_path, tmp_path / "mine.html")
    left = {path.name for path in (tmp_path / "mine_files").iterdir()}
    assert "notes.txt" in left
    assert not left & {"curves_Hopper-v5.png", "curves.csv"}


def made_up(arm, member, seed, value):
    return {"arm": arm, "core": "" if arm == "scratch" else "c", "member": member, "seed": seed, "eval_return_mean": value}


def test_members_are_paired_with_themselves_and_missing_ones_are_missing():
    effect = {0: 0.0, 1: 5.0, 2: 9.0}
    runs = {
        "transfer": [made_up("transfer", m, s, effect[m]) for m in (0, 1, 2) for s in range(4)],
        "random": [made_up("random", m, s, effect[m]) for m in (0, 1) for s in range(4)] + [made_up("random", 2, 1, effect[2])],
        "scratch": [made_up("scratch", 0, s, 1.0) for s in range(4)],
    }
    arms = {name: Arm(name, rows, None) for name, rows in runs.items()}
    scores = Group("target", "ppo", "c", arms, 0.0, 10.0, "").scores
    assert scores["transfer"].shape == scores["random"].shape == (3, 4)
    assert scores["scratch"].shape == (1, 4)
    both = paired(scores, ("transfer", "random"))
    np.testing.assert_array_equal(both["transfer"] - both["random"], np.zeros((3, 1)))


def test_a_failed_run_counts_as_the_worst_one():
    arms = {
        "transfer": Arm("transfer", [made_up("transfer", 0, s, 7.0 + s) for s in range(3)], None),
        "scratch": Arm(
            "scratch", [made_up("scratch", 0, 0, 3.0)], None, [made_up("scratch", 0, 2, None) | {"error": "DivergedError: a"}]
        ),
    }
    group = Group("target", "ppo", "c", arms, None, None, "")
    np.testing.assert_array_equal(group.scores["scratch"], [[3.0, np.nan, 3.0]])
    assert group.verdict.scratch.mean == 5.0
    assert "scratch 1" in group.verdict.reason
    row = arm_rows(group)[1]
    assert (row["n"], row["failed"], row["mean"]) == (2, 1, 3.0)


@pytest.mark.parametrize(
    ("changed", "message"),
    [
        (GRID.replace("steps = 256", "steps = 257"), "holds runs of ppo on InvertedDoublePendulum-v5 with 2 budgets"),
        (
            GRID.replace("[[part]]\n\n[[part]]", '[[part]]\ntrainer = [{ set = { "ppo.gamma" = 0.8 } }]\n\n[[part]]'),
            "holds runs of ppo on InvertedDoublePendulum-v5 with 2 settings",
        ),
    ],
)
def test_runs_of_two_settings_under_one_name_are_refused(results, tmp_path, changed, message):
    root = tmp_path / "two"
    shutil.copytree(results, root)
    (root / "grid.toml").write_text(changed)
    cell = next(cell for cell in load_cells(root / "grid.toml") if cell.arm == "scratch")
    assert run_cell(cell, root, "the command").error == ""
    with pytest.raises(RunDirectoryError, match=message):
        load_matrix(root)


def test_what_cannot_be_reported_is_one_line(results, tmp_path, monkeypatch, capsys):
    (tmp_path / "file").touch()
    (tmp_path / "known").touch()
    (tmp_path / "empty").mkdir()
    for root, out, message in (
        (tmp_path / "empty", tmp_path / "page.html", f"{tmp_path}/empty holds no finished run; make some with"),
        (tmp_path / "none", tmp_path / "page.html", f"{tmp_path}/none is no folder; pass one that"),
        (tmp_path / "file", tmp_path / "page.html", f"{tmp_path}/file is no folder; pass one that"),
        (tmp_path, tmp_path / "page.html", f"{tmp_path}/known is a file; make it a folder"),
        (results, tmp_path, f"{tmp_path} is a folder; pass a file, as --out {tmp_path}/report.html"),
        (results, Path(), ". is a folder; pass a file, as --out report.html"),
        (results, Path("/dev/null"), "/dev/null is no file that could be replaced"),
        (results, tmp_path / "file" / "page.html", f"{tmp_path}/file/page_files cannot be written (Not a directory)"),
    ):
        monkeypatch.setattr("sys.argv", ["report", str(root), "--out", str(out)])
        assert main() == 2
        error = capsys.readouterr().err
        assert error.startswith(f"error: {message}")
        assert error.count("\n") == 1


def test_running_mean_is_of_what_is_there():
    np.testing.assert_allclose(running_mean(np.array([1.0, 3.0, 5.0, 7.0]), 2), [1.0, 2.0, 4.0, 6.0])
    assert running_mean(np.array([1e20, 3.0, 5.0]), 2)[-1] == 4.0
