import pytest

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
    """Writes a grid with some lines replaced."""

    def write(old="", new="", more=""):
        assert old in GRID
        path = tmp_path / "grid.toml"
        path.write_text(GRID.replace(old, new) + more)
        return path

    return write
