import csv
import signal
import subprocess
import sys
import time
from collections import Counter
from dataclasses import fields
from pathlib import Path

import pytest

from experiments import matrix, plan, running
from experiments.matrix.cell_folder import ERROR, EVALUATIONS, MEASURED, folder
from experiments.matrix.grid import Grid, Trainer
from experiments.matrix.grid_toml import load_cells
from experiments.matrix.table import KNOWN, TABLE, collect, ended, write_csv
from transferkit.errors import TransferkitError

DOCS = Path(__file__).parents[2] / "docs" / "experiments.md"
GRID = """
steps = 150
cores = ["inverted-pendulum-v1"]
targets = ["InvertedDoublePendulum-v5"]
arms = ["transfer", "scratch", "random", "zero-action"]
seeds = "0-1"
eval_episodes = 2
"""


@pytest.fixture
def grid(tmp_path):
    def write(text=GRID):
        path = tmp_path / "grid.toml"
        path.write_text(text)
        return path

    return write


def results(out, table=TABLE):
    with (out / table).open() as file:
        return [{name: value for name, value in row.items() if name != "seconds"} for row in csv.DictReader(file)]


def start(grid, out):
    command = [sys.executable, "-m", "experiments.matrix", str(grid), "--out", str(out), "--workers", "1"]
    # A shell's background job ignores Ctrl-C, and so would what it starts.
    heed = lambda: signal.signal(signal.SIGINT, signal.SIG_DFL)  # noqa: E731
    return subprocess.Popen(command, stdout=subprocess.DEVNULL, stderr=subprocess.PIPE, text=True, preexec_fn=heed)  # noqa: PLW1509


def test_a_grid_is_a_product_in_which_nothing_is_run_twice(grid):
    text = GRID.replace('arms = ["transfer"', 'members = [0, 1]\narms = ["constant", "scratch-matched", "transfer"')
    cells = load_cells(grid(text))
    counts = Counter(cell.arm for cell in cells)
    assert counts == {"transfer": 4, "random": 4, "scratch-matched": 2, "scratch": 2, "constant": 2, "zero-action": 1}
    assert len({cell.id for cell in cells}) == len(cells)
    quoted_or_not = 'ppo.learning_rate = 0.5, ppo.schedule = "fixed", ppo.epochs = 3, "ppo.max_grad_norm" = "none"'
    trained = GRID + f"[[trainer]]\nset = {{ {quoted_or_not} }}\n"
    settings = {
        (cell.config.ppo.epochs, cell.config.ppo.max_grad_norm) for cell in load_cells(grid(trained)) if cell.arm == "transfer"
    }
    assert settings == {(3, None)}
    parts = GRID + '[[part]]\n[[part]]\ntargets = ["InvertedPendulum-v5"]\narms = ["scratch"]\n'
    assert len(load_cells(grid(parts))) == 7 + 2


def test_the_grid_of_the_docs_has_every_key(grid):
    text = DOCS.read_text().partition("```toml\n")[2].partition("```")[0]
    keys = {line.partition(" = ")[0] for line in text.splitlines()}
    assert {f.name for f in (*fields(Grid), *fields(Trainer))} - keys == {"trainer", "steps", "seconds"}
    assert len(load_cells(grid(text))) == 10 * (2 * 4 + 1) + 1 + 5 * (2 * 4 + 1) + 1


@pytest.mark.parametrize(
    ("old", "new", "message"),
    [
        ("steps = 150", "", "grid.toml: no budget given"),
        ('"transfer"', '"transfers"', "line 5: unknown arm 'transfers'"),
        ("InvertedDoublePendulum-v5", "Inverted-v0", "line 4: unknown environment 'Inverted-v0'"),
        ("inverted-pendulum-v1", "nothing-v1", "line 3: .*nothing-v1"),
        ('"0-1"', '"1-0"', "line 6: .*must be a list of whole numbers"),
        ("steps = 150", "steps = 150\nmembers = [9]", "line 3: .*no member 9"),
        ("steps = 150", "step = 150", "line 2: unknown key 'step'"),
        ("eval_episodes = 2", '[[trainer]]\nset = { "ppo.speed" = 1 }', "line 8: .*no field ppo.speed"),
        ("eval_episodes = 2", '[[trainer]]\nalgo = "sac"', "line 8: unknown algo 'sac'"),
        (
            "eval_episodes = 2",
            '[[trainer]]\nalgo = "dyna-ppo"\npreset = "paper"',
            "line 9: dyna-ppo needs .* set preset default",
        ),
        ("eval_episodes = 2", "eval_episodes = ", "is no TOML"),
        ("eval_episodes = 2", "[[part]]\n[[part]]\nseeds = [5, 5]", "line 9: the grid has seed 5 more than once"),
        ("eval_episodes = 2", 'part = [{ seeds = "0-1" }, { seeds = [5, 5] }]', "line 7: the grid has seed 5 more than once"),
        ("eval_episodes = 2", "part = [1]", r"grid.toml: part=\[1\] must be written as \[\[part\]\]"),
        ("eval_episodes = 2", "part = []", "must be written as"),
        ("steps = 150", "", "no budget given; set episodes N, steps N or seconds S"),
        (
            "eval_episodes = 2",
            '[[part]]\n[[part]]\ntrainer = [{ set = { "ppo.gamma" = 0.9 } }]',
            "runs of ppo on InvertedDoublePendulum-v5 with 2 settings; .*its own name",
        ),
        (
            "eval_episodes = 2",
            "[[part]]\n[[part]]\nsteps = 200\nseeds = [5]",
            "ppo on InvertedDoublePendulum-v5 with 2 budgets",
        ),
        (
            "eval_episodes = 2",
            '[[part]]\n[[part]]\nseeds = [5]\ntrainer = [{ set = { "wrap.residual" = 0 } }]',
            "ppo on InvertedDoublePendulum-v5 with 2 wrappings",
        ),
        ("eval_episodes = 2", '[[trainer]]\n[[trainer]]\nname = "two"', "line 9: trainers 'ppo' and 'two' are the same runs"),
        (
            "eval_episodes = 2",
            "[[part]]\n[[part]]\neval_episodes = 3\narms = ['zero-action']",
            "arm zero-action.*use one eval_ep",
        ),
        ("eval_episodes = 2", '[[trainer]]\nset = { "ppo.hidden" = [-1] }', "line 8: hidden=.* whole numbers from 1"),
        ("eval_episodes = 2", '[[trainer]]\nset = { "ppo.gamma" = 2.0 }', "line 8: gamma=2.0 must lie"),
        ('"0-1"', '"0-²"', "line 6: .*must be a list of whole numbers"),
        ("eval_episodes = 2", '[[trainer]]\nset = { "wrap.tap" = "feature" }', "line 8: .*did you mean features"),
        ("eval_episodes = 2", '[[trainer]]\nset = { "ppo.hidden" = [64, 0.5] }', "line 8: .*another type"),
        ("eval_episodes = 2", '[[trainer]]\nset = { "wrap.freeze" = { core = "all" } }', "line 8: freeze core='all' must"),
        ("eval_episodes = 2", '[[trainer]]\nset = { "ppo.gamma" = [0.9] }', "line 8: .*another type than 0.99"),
        ("eval_episodes = 2", '[[trainer]]\nset = { "ppo.capacity" = 1 }', "line 8: .*no field ppo.capacity"),
        ("eval_episodes = 2", '[[trainer]]\nset = { "ppo.gamma" = "none" }', "line 8: .*another type than 0.99"),
        ('seeds = "0-1"', "seeds = [-1]", "line 6: seeds=.* whole numbers from 0"),
        ('"transfer"', "5", "line 5: arms=.* must be a list of names"),
        ("eval_episodes = 2", "members = []", "line 7: the grid has no members"),
        ("eval_episodes = 2", "trainer = [1]", "line 7: trainer=.* must be a list of tables"),
        ("eval_episodes = 2", "[[trainer]]\nset = 3", "line 8: set=3 must be a table"),
        ("eval_episodes = 2", "eval_every = -1", "line 7: eval_every=-1 must be at least 0; set eval_every"),
        ("eval_episodes = 2", "eval_episodes = 0", "line 7: eval_episodes=0 must be at least 1; set eval_episodes"),
        ('"0-1"', '"0-99999999999"', "line 6: .* are more than 10,000"),
        ("eval_episodes = 2", '[[trainer]]\nset = { "ppo.learnin_rate" = 1 }', "line 8: .*did you mean ppo.learning_rate"),
        (
            'Pendulum-v5"]\narms',
            'Pendulum-v5", "Reacher-v5"]\ntrainer = [{ set = { "wrap.adapter" = "semantic" } }]\narms',
            "line 5: adapter='semantic' finds nothing in Reacher-v5",
        ),
        (
            'arms = ["transfer"',
            'trainer = [{ preset = "paper" }]\narms = ["padded", "transfer"',
            "freeze names no part 'output_adapter'",
        ),
        ("steps = 150", 'seconds = "a"', "line 2: seconds='a' must be a number"),
        ("eval_episodes = 2", '[[trainer]]\nset = { "dyna.tau" = 3 }', "line 8: tau=3 .*; set dyna.tau"),
    ],
)
def test_a_wrong_grid_is_refused_before_anything_runs(grid, old, new, message):
    with pytest.raises(TransferkitError, match=message):
        load_cells(grid(GRID.replace(old, new)))


def test_a_killed_matrix_goes_on_to_the_same_table(grid, tmp_path):
    path = grid()
    start(path, tmp_path / "whole").wait(timeout=120)
    killed = start(path, tmp_path / "killed")
    deadline = time.monotonic() + 120
    while not list((tmp_path / "killed").glob("cells/*/run/result.json")) and time.monotonic() < deadline:
        time.sleep(0.05)
    killed.send_signal(signal.SIGKILL)
    killed.wait()
    assert not (tmp_path / "killed" / TABLE).exists()
    again = start(path, tmp_path / "killed")
    assert again.wait(timeout=120) == 0, again.stderr.read()
    assert results(tmp_path / "killed") == results(tmp_path / "whole")
    assert results(tmp_path / "killed", EVALUATIONS) == results(tmp_path / "whole", EVALUATIONS)
    assert len(results(tmp_path / "whole")) == 7


def test_ctrl_c_says_that_the_same_command_goes_on(grid, tmp_path):
    running = start(grid(GRID.replace("steps = 150", "steps = 100000")), tmp_path / "out")
    deadline = time.monotonic() + 120
    while not list((tmp_path / "out").glob("cells/*/run/run.json")) and time.monotonic() < deadline:
        time.sleep(0.05)
    running.send_signal(signal.SIGINT)
    assert running.wait(timeout=60) == 130
    assert running.stderr.read().strip().endswith("the same command goes on")


def test_a_failed_cell_is_reported_and_tried_again(grid, tmp_path, monkeypatch):
    cell = load_cells(grid())[0]
    with monkeypatch.context() as patch:
        patch.setattr(running, "run_training", lambda *_, **__: 1 / 0)
        outcome = running.run_cell(cell, tmp_path, "test")
    assert outcome.error == "ZeroDivisionError: division by zero"
    error = folder(tmp_path, cell) / ERROR
    assert error.exists()
    assert collect(tmp_path) == []
    (tmp_path / "copy" / KNOWN).mkdir(parents=True)
    (tmp_path / TABLE).rename(tmp_path / "copy" / KNOWN / "failed.csv")
    (failed,) = ended(tmp_path / "copy", [])[1]
    assert ended(tmp_path, []) == ([], [failed])
    finished = failed | dict.fromkeys(MEASURED, 1) | {"error": ""}
    (tmp_path / KNOWN).mkdir()
    write_csv(tmp_path / KNOWN / "finished.csv", [finished])
    assert ended(tmp_path, [])[1] == []  # what finished elsewhere stays
    (tmp_path / KNOWN / "finished.csv").unlink()
    assert failed["error"] == outcome.error
    assert running.run_cell(cell, tmp_path, "test").error == ""
    assert not error.exists()
    assert collect(tmp_path)[0]["arm"] == "transfer"


def test_a_table_stands_for_runs_whose_folders_are_gone(grid, tmp_path, monkeypatch, capsys):
    path, out = grid(), tmp_path / "out"
    assert running.run_cell(load_cells(path)[0], tmp_path / "lost", "test").error == ""
    rows = collect(tmp_path / "lost")
    (out / KNOWN).mkdir(parents=True)
    earlier = (tmp_path / "lost" / TABLE).rename(out / KNOWN / "earlier.csv")
    assert ended(out, []) == (rows, [])
    monkeypatch.setattr("sys.argv", ["matrix", str(path), "--out", str(out), "--dry-run"])
    assert matrix.main() == 0
    assert "7 runs, 6 to do" in capsys.readouterr().out
    whole, score = earlier.read_text(), str(rows[0]["eval_return_mean"])
    (out / KNOWN / "other.csv").write_text(whole.replace(score, "1.5"))
    assert matrix.main() == 2
    assert f"with another score than before it ({score} and 1.5)" in capsys.readouterr().err
    (out / KNOWN / "other.csv").unlink()
    for cut in (whole[:-80], whole.replace(score, "nan"), whole.replace(score, "")):
        earlier.write_text(cut)
        assert matrix.main() == 2
        assert "line 2, is no run that ended; put a cells.csv" in capsys.readouterr().err
    earlier.write_bytes(b"\xff\x00")
    assert matrix.main() == 2
    assert "is no table" in capsys.readouterr().err
    earlier.write_text("id,core\n")
    assert matrix.main() == 2
    assert "has no column member" in capsys.readouterr().err


def test_the_plan_counts_time_by_runs_of_the_same_kind_and_budget(grid, monkeypatch):
    monkeypatch.setattr(plan, "trial", lambda _: plan.Pace(1.0, 10.0, 0.4))  # 60 s for 150 steps
    cells = load_cells(grid())
    scratch = next(cell for cell in cells if cell.arm == "scratch")
    row = scratch.row | {"budget_episodes": None, "budget_steps": 150, "budget_seconds": None, "seconds": 120.0}
    todo = [cell for cell in cells if cell is not scratch]
    text = plan.plan(cells, todo, [row, row | {"seconds": 180.0}], 2)
    # four runs with a core are tried, 60 s each; the scratch run that is left takes the 150 s that such runs took
    assert "7 runs, 6 to do; about 3 minutes of training with 2 workers" in text
    assert "78 s" in text
    assert "finished runs, a trial of 3 s" in text
    known = plan.plan(cells, todo, [row, row | {"core": "inverted-pendulum-v1"}], 1)
    assert "about 10 minutes of training with 1 workers" in known
    other_budget = plan.plan(cells, todo, [row | {"budget_steps": 1500}], 1)
    assert "about 5 minutes" in other_budget
    episodes = load_cells(grid(GRID.replace("steps = 150", "episodes = 150")))
    assert "60 to 600 s" in plan.plan(episodes, episodes, [], 1)
    assert "finished" not in plan.plan(cells, [], [row], 1)


def test_a_trial_that_fails_stops_nothing(grid, monkeypatch):
    monkeypatch.setattr(plan, "run_training", lambda *_, **__: 1 / 0)
    cells = load_cells(grid())
    text = plan.plan(cells, cells, [], 1)
    assert "nothing: a trial failed (division by zero)" in text
    assert "7 to do" in text


def test_what_cannot_be_written_or_reached_is_one_line(grid, tmp_path, monkeypatch, capsys):
    (tmp_path / "file").touch()
    command = ["matrix", str(grid()), "--out"]
    for more, message in (
        ([str(tmp_path / "file")], f"{tmp_path}/file is no folder; pass another --out DIR"),
        (["/proc/none"], "/proc/none cannot be written (No such file or directory); pass another --out DIR"),
        ([str(tmp_path / "out"), "--ray", "nonsense"], "--ray nonsense is no address; pass auto, HOST:PORT or ray://HOST:PORT"),
        ([str(tmp_path / "out"), "--workers", "0"], "workers=0 must be at least 1; pass --workers"),
    ):
        monkeypatch.setattr("sys.argv", [*command, *more])
        assert matrix.main() == 2
        assert capsys.readouterr().err == f"error: {message}\n"
    assert not (tmp_path / "out").exists()


def test_what_takes_long_to_import_waits_until_ctrl_c_is_heeded():
    code = "import sys, experiments.matrix, experiments.report.__main__; sys.exit(bool({'torch', 'numpy'} & {*sys.modules}))"
    subprocess.run([sys.executable, "-c", code], check=True, timeout=60)
