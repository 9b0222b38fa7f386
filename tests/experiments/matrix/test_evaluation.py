import numpy as np
import pytest

from experiments.matrix.evaluation import forward_speed
from experiments.matrix.grid_toml import load_cells
from experiments.matrix.results import read_results
from experiments.matrix.runner import run_cell
from transferkit.config import TrainConfig
from transferkit.evaluation import ZeroPolicy, evaluate

GRID = """
steps = 0
cores = ["inverted-pendulum-v1"]
targets = ["InvertedPendulum-v5"]
members = [0, 1]
arms = ["transfer", "shuffled", "random-action", "zero-action"]
seeds = [0]
eval_episodes = 3
"""


def test_untrained_policies_are_evaluated_as_they_begin(tmp_path):
    (tmp_path / "grid.toml").write_text(GRID)
    for cell in load_cells(tmp_path / "grid.toml"):
        assert run_cell(cell, tmp_path, "test").error == ""
    rows = read_results(tmp_path).finished
    assert [row.steps for row in rows] == [0] * 6
    assert all(row.commit and row.mujoco for row in rows)
    scores = {(row.arm, row.member): row.eval_return_mean for row in rows}
    assert scores["transfer", 0] == scores["transfer", 1] == 1000.0  # it is the core's own task
    assert scores["zero-action", 0] == evaluate(ZeroPolicy(1), "InvertedPendulum-v5", episodes=3).mean
    assert scores["random-action", 0] != scores["zero-action", 0]


def test_forward_speed_is_distance_over_time():
    class Recorded(ZeroPolicy):
        def act(self, observation):
            positions.append(observation)
            return super().act(observation)

    positions = []
    config = TrainConfig("HalfCheetah-v5", eval_episodes=1, steps=1)
    speed = forward_speed(Recorded(6), config)
    assert len(positions) == 1000
    assert speed == pytest.approx(np.mean([observation[0, 8] for observation in positions]), abs=0.02)  # its own x velocity


def test_no_speed_where_none_is_reported():
    assert forward_speed(ZeroPolicy(1), TrainConfig("InvertedPendulum-v5", eval_episodes=2, steps=1)) is None
