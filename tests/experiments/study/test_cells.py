from dataclasses import replace
from types import SimpleNamespace

import pytest

from experiments.matrix.table import Row
from experiments.study.cells import CELLS
from experiments.study.kinds import cross, runs


def row(arm, trainer, seed, score, seconds=1.0, core=""):
    identity = (f"{arm}{trainer}{seed}", core, 0, "target", arm, trainer, "ppo", "default-v2", "{}", seed)
    return Row(*identity, 200, 1500, None, 0, 20, 1, 2, seconds, eval_return_mean=score, eval_return_std=2.0)


A = [row("scratch", "a", seed, score, seconds) for seed, score, seconds in ((0, 1.0, 3.0), (1, 2.0, 4.0), (2, 6.0, 8.0))]
B = [row("scratch", "b", seed, score) for seed, score in ((0, 0.0), (1, 1.0), (2, 2.0))]
IDLE = [replace(row("zero-action", "", 0, 5.0), algo="", preset="")]


POINTS = [{"seconds": seconds, "return_mean": 10.0 * seconds} for seconds in (0.0, 1.0, 2.5, 8.0)]
STUDY = SimpleNamespace(rows=A + B + IDLE, curves={one.id: POINTS for one in A + B})


@pytest.mark.parametrize(
    ("cell", "text"),
    [
        ("mean", "3"),
        ("mean, each", "3 (1, 2, 6)"),
        ("mean, interval", "3 (-4 to 10)"),  # 3 -+ 4.303 * 2.646 / sqrt(3)
        ("each seed", "1, 2, 6"),
        ("minus", "2 (-2 to 6)"),  # of 1, 1 and 4: 2 -+ 4.303 * 1.732 / sqrt(3)
        ("at equal time", "10"),  # the fastest run takes 1 s
        ("budget", "200 episodes, 1,500 steps"),
        ("seeds", "0 to 2 (3)"),
        ("seconds", "5"),
        ("seconds, range", "3 to 8"),
    ],
)
def test_a_cell_by_hand(cell, text):
    assert CELLS[cell](STUDY, A, B) == text


def test_one_run_has_the_interval_of_its_episodes():
    assert CELLS["mean, interval"](STUDY, IDLE, []) == "5 (4 to 6)"  # 5 -+ 2.093 * 2 / sqrt(20)


def test_a_line_for_every_trainer():
    lines = runs(STUDY, ["trainer"], {"score": "mean", "minus b": "minus"}, against={"trainer": "b"})
    assert lines == [["trainer", "score", "minus b"], ["a", "3", "2 (-2 to 6)"], ["b", "1", "-"]]


def test_a_column_for_every_selection():
    columns = {"a": {"trainer": "a"}, "nothing": {"arm": "zero-action"}, "none": {"arm": "transfer"}}
    assert cross(STUDY, ["target"], columns, "mean") == [["target", "a", "nothing", "none"], ["target", "3", "5", "-"]]
    (_, line) = cross(STUDY, ["trainer"], {"score": {}}, "mean", where={"trainer": "b"})
    assert line == ["b", "1"]


def test_the_lowest_evaluation_after_the_first_that_is_good_enough():
    returns = {"a": [10.0, 9100.0, 8000.0, 9300.0], "b": [9000.0, 9050.0], "c": [100.0]}
    runs = [replace(A[0], id=name) for name in returns]
    study = SimpleNamespace(curves={name: [{"return_mean": value} for value in own] for name, own in returns.items()})
    assert CELLS["lowest after 9000"](study, runs, []) == "8000"
    assert CELLS["lowest after 9000"](study, runs[2:], []) == "-"


def test_speeds_stand_by_seed():
    rows = [replace(one, forward_speed=speed) for one, speed in zip(A, (0.31, 1.96, 0.5), strict=True)]
    assert CELLS["speed, each"](STUDY, rows[::-1], []) == "0.3, 2.0, 0.5"
    assert CELLS["speed, each"](STUDY, A, []) == "-"
