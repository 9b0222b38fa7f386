"""The report of a small real matrix: its files, its tables, and its page in a real browser."""

import csv
import shutil
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest
from playwright.sync_api import sync_playwright

from experiments.matrix.results import KNOWN
from experiments.report.__main__ import main
from experiments.report.page import difference, ends, supported
from experiments.report.write import report


@pytest.fixture(scope="session")
def page(results):
    command = [sys.executable, "-m", "experiments.report", str(results), "--out", str(results / "report.html")]
    subprocess.run(command, check=True, capture_output=True, timeout=120)
    return results / "report.html"


def read(path):
    with path.open() as file:
        return list(csv.DictReader(file))


def known_from(page, root):
    """A matrix of which only the rows are known."""
    (root / KNOWN).mkdir()
    shutil.copy(page.with_name("report_files") / "runs.csv", root / KNOWN)
    return root


def test_known_rows_give_the_same_tables_without_curves(page, tmp_path):
    report(known_from(page, tmp_path), tmp_path / "rows.html")
    for name in ("runs", "arms", "verdicts", "aggregates", "paper_measures"):
        assert read(tmp_path / "rows_files" / f"{name}.csv") == read(page.with_name("report_files") / f"{name}.csv")
    assert not list((tmp_path / "rows_files").glob("curves*"))


def test_tables_say_what_the_runs_say(page):
    folder = page.with_name("report_files")
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
        tab.locator("#gain-0").select_option("jumpstart")
        tab.locator(".sorts th", has_text="target").click()  # downwards
        first = tab.locator(".sorts tbody tr").first
        assert first.locator("td").nth(2).text_content() == "InvertedPendulum-v5"
        first.locator("a").click()
        tab.wait_for_function("document.querySelector('.cell:not([hidden]) h3').textContent.includes(' InvertedPendulum-v5')")
        assert not errors
        browser.close()


def test_a_report_replaces_what_an_earlier_one_left(page, tmp_path):
    (tmp_path / "mine_files").mkdir()
    for name in ("curves_Hopper-v5.png", "curves.csv", "notes.txt"):
        (tmp_path / "mine_files" / name).touch()
    report(known_from(page, tmp_path), tmp_path / "mine.html")
    left = {path.name for path in (tmp_path / "mine_files").iterdir()}
    assert "notes.txt" in left
    assert not left & {"curves_Hopper-v5.png", "curves.csv"}


def test_what_cannot_be_reported_is_one_line(results, tmp_path, capsys):
    (tmp_path / "file").touch()
    (tmp_path / "known").touch()
    (tmp_path / "empty").mkdir()
    for root, out, message in (
        (tmp_path / "empty", tmp_path / "page.html", f"{tmp_path}/empty holds no finished run; make some with"),
        (tmp_path / "none", tmp_path / "page.html", f"{tmp_path}/none is not a folder; pass one that"),
        (tmp_path / "file", tmp_path / "page.html", f"{tmp_path}/file is not a folder; pass one that"),
        (tmp_path, tmp_path / "page.html", f"{tmp_path}/known is a file; make it a folder"),
        (results, tmp_path, f"{tmp_path} is a folder; choose a file as --out, such as report.html in it"),
        (results, Path(), ". is a folder; choose a file as --out"),
        (results, Path("/dev/null"), "/dev/null is not a file that could be replaced; choose another --out"),
        (results, tmp_path / "file" / "page.html", f"{tmp_path}/file/page_files cannot be written (Not a directory)"),
    ):
        assert main([str(root), "--out", str(out)]) == 2
        error = capsys.readouterr().err
        assert error.startswith(f"error: {message}")
        assert error.count("\n") == 1


def test_a_number_has_the_digits_that_its_interval_supports():
    assert (supported(1234.567, 1100.0, 1370.0), ends(1100.4, 1370.4)) == ("1230", "1100 to 1370")  # give or take 135
    assert (supported(0.98765, 0.97, 1.01), difference(0.98765, 0.97, 1.01)) == ("0.988", "+0.988")
    assert ends(-259.89, -3.29) == "-260 to -3"  # which is below 0
    assert (ends(-7.02, -0.036), ends(28.6, 9125.0)) == ("-7.0 to -0.04", "3e+01 to 9100")
    assert (supported(12345.0, 12345.0, 12345.0), difference(0.0, -300.0, 300.0)) == ("12,345", "+0")
    assert (supported(0.5, None, None), supported(2.0, 2.0, 2.0), ends(None, None)) == ("0.5", "2", "")
