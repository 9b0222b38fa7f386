"""A small real matrix, run once."""

import shutil

import pytest

from experiments.matrix.grid_toml import load_cells
from experiments.matrix.runner import run_cell

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


@pytest.fixture(scope="session")
def results(tmp_path_factory):
    """The matrix's folder; copy it before you change it."""
    root = tmp_path_factory.mktemp("matrix")
    (root / "grid.toml").write_text(GRID)
    for cell in load_cells(root / "grid.toml"):
        assert run_cell(cell, root, "the command").error == ""
    return root


@pytest.fixture
def copy(results, tmp_path):
    """A copy of the matrix's folder."""
    return shutil.copytree(results, tmp_path / "copy")
