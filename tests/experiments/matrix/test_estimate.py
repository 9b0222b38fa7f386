from dataclasses import replace

from experiments.matrix.estimate import Pace, plan
from experiments.matrix.grid_toml import load_cells


def a_minute(_):
    return Pace(1.0, 10.0, 0.4)  # 60 s for 150 steps


def test_the_plan_counts_time_by_runs_of_the_same_kind_and_budget(grid):
    cells = load_cells(grid())
    scratch = next(cell for cell in cells if cell.arm == "scratch")
    row = replace(scratch.row, seconds=120.0)
    todo = [cell for cell in cells if cell is not scratch]
    text = plan(cells, todo, [row, replace(row, seconds=180.0)], 2, a_minute)
    # four runs with a core are tried, 60 s each; the scratch run that is left takes the 150 s that such runs took
    assert "7 runs, 6 to do; about 3 minutes of training with 2 workers" in text
    assert "78 s" in text
    assert "finished runs, a trial of 3 s" in text
    known = plan(cells, todo, [row, replace(row, core="inverted-pendulum-v1")], 1, a_minute)
    assert "about 10 minutes of training with 1 workers" in known
    assert "about 5 minutes" in plan(cells, todo, [replace(row, budget_steps=1500)], 1, a_minute)
    assert "finished" not in plan(cells, [], [row], 1, a_minute)


def test_a_budget_of_episodes_takes_a_range(grid):
    episodes = load_cells(grid("steps = 150", "episodes = 150"))
    assert "60 to 600 s" in plan(episodes, episodes, [], 1, a_minute)


def test_a_trial_that_fails_stops_nothing(grid):
    cells = load_cells(grid())
    text = plan(cells, cells, [], 1, lambda _: 1 / 0)
    assert "nothing: a trial failed (division by zero)" in text
    assert "7 to do" in text


def test_what_is_not_trained_takes_no_time(grid):
    cells = load_cells(grid("steps = 150", "steps = 0"))
    assert "7 runs, 7 to do; about 0 minutes" in plan(cells, cells, [], 1, lambda _: 1 / 0)
