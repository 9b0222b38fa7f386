"""Every committed study: its tables, its rows, and its page."""

import shutil
from pathlib import Path

import pytest

from experiments import peer_runs
from experiments.matrix.cell import Cell
from experiments.study.__main__ import check, main, write
from experiments.study.figure import draw
from experiments.study.readme import _markdown
from experiments.study.rooms import STUDIES, Study, StudyError, find, names
from transferkit.config import PRESETS, TrainConfig

ROOT = Path(__file__).parents[3]
WITH_ROWS = [name for name in names() if (STUDIES / name / "rows.csv").exists()]


@pytest.mark.parametrize("name", names())
def test_every_table_says_what_its_rows_say(name, capsys):
    assert check(find(name)) == 0, capsys.readouterr().out


@pytest.mark.parametrize("name", WITH_ROWS)
def test_every_row_is_of_a_preset_and_has_the_id_of_its_run(name):
    for row in find(name).rows:
        if row.trainer == peer_runs.TRAINER:
            assert peer_runs.row_id(TrainConfig(row.target, seed=row.seed, steps=row.budget_steps)) == row.id, row
            continue
        assert not row.algo or row.preset in PRESETS[row.algo]
        assert Cell.from_row(row).id == row.id, row
        assert Cell.from_row(row).row.overrides == row.overrides, row


@pytest.mark.parametrize("name", WITH_ROWS)
def test_every_curve_belongs_to_a_row(name):
    study = find(name)
    if (study.folder / "curves.csv").exists():
        assert {*study.curves} <= {row.id for row in study.rows}


@pytest.mark.parametrize("name", names())
def test_a_page_is_short_and_has_a_verdict_and_a_command(name):
    text = find(name).readme.read_text()
    assert 30 <= text.count("\n") <= 80
    assert "**Verdict: " in text
    assert "python -m experiments." in text
    assert f"studies/{name}/README.md" in (STUDIES.parent / "README.md").read_text()
    assert f"`{name}`" in (ROOT / "docs" / "evidence.md").read_text()


def test_notes_say_that_they_are_no_claim():
    notes = list(STUDIES.glob("*/NOTES.md"))
    assert notes
    for path in notes:
        assert path.read_text().startswith("These are tuning notes and no claim")


def copy_of(name, tmp_path):
    return Study(shutil.copytree(STUDIES / name, tmp_path / name))


def test_a_changed_number_is_found_and_mended(tmp_path, capsys):
    study = copy_of("core_dyna", tmp_path)
    right = study.readme.read_text()
    assert "5093 (2520 to 7666)" in right
    study.readme.write_text(right.replace("5093 (2520", "5094 (2520"))
    assert check(study) == 1
    shown = capsys.readouterr().out
    assert any(line.startswith("-| core |") and "5094 (2520" in line for line in shown.splitlines())
    assert any(line.startswith("+| core |") and "5093 (2520" in line for line in shown.splitlines())


def test_a_changed_row_is_found(tmp_path):
    study = copy_of("ppo_baseline", tmp_path)
    rows = study.folder / "rows.csv"
    rows.write_text(rows.read_text().replace("2260.52", "3260.52"))
    assert check(study) == 1


def test_the_command_checks_a_study_and_refuses_what_is_none(capsys):
    assert main(["core_dyna", "--check"]) == 0
    assert main(["core_dyn", "--check"]) == 2
    assert "no study 'core_dyn'; there are anchor" in capsys.readouterr().err


ARMS_OF_NOTHING = "kind = 'arms'\nover = 'target'\ncolumns = {a = 'b'}"


@pytest.mark.parametrize("spec", ["kind = 'nothing'", "kind = 'runs'", "kind =", ARMS_OF_NOTHING])
def test_a_table_that_cannot_be_made_is_named(tmp_path, spec):
    study = copy_of("ppo_baseline", tmp_path)
    study.readme.write_text(f"<!-- table\n{spec}\n-->\n<!-- end -->\n")
    with pytest.raises(StudyError):
        check(study)


def test_a_figure_ends_at_the_numbers_of_the_table(tmp_path):
    study = copy_of("anchor", tmp_path)
    (study.folder / "figure.png").unlink()
    assert write(study) == 0
    assert (study.folder / "figure.png").exists()
    two_poles, cart_pole = draw(study).axes
    assert two_poles.get_title() == "InvertedDoublePendulum-v5"
    ends = {line.get_label(): round(line.get_ydata()[-1]) for line in cart_pole.get_lines()}
    assert ends == {"core, anchor 0.1": 985, "scratch, anchor 0.1": 280, "core, no anchor": 771}


def test_a_name_from_outside_stays_in_its_cell():
    assert _markdown([["trainer", "n"], ["a|b\nc", "1"]]) == "| trainer | n |\n|---|---|\n| a\\|b c | 1 |\n"
