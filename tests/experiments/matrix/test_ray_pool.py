"""A matrix on a Ray cluster of several nodes on this machine, of which one is lost."""

import csv
import os
import subprocess
import sys
import time

from experiments.matrix.results import TABLE

os.environ["RAY_USAGE_STATS_ENABLED"] = "0"
from ray.cluster_utils import Cluster

GRID = """
steps = 2000
cores = ["inverted-pendulum-v1"]
targets = ["InvertedDoublePendulum-v5"]
arms = ["transfer", "scratch"]
seeds = "0-1"
eval_episodes = 2
"""


def rows(out):
    with (out / TABLE).open() as file:
        return [{name: value for name, value in row.items() if name != "seconds"} for row in csv.DictReader(file)]


def start(grid, out, *more):
    command = [sys.executable, "-m", "experiments.matrix", str(grid), "--out", str(out), *more]
    return subprocess.Popen(command, stdout=subprocess.DEVNULL, stderr=subprocess.PIPE, text=True)


def test_a_lost_node_changes_nothing(tmp_path):
    grid = tmp_path / "grid.toml"
    grid.write_text(GRID)
    cluster = Cluster(initialize_head=True, head_node_args={"num_cpus": 1})
    doomed = cluster.add_node(num_cpus=1)
    try:
        running = start(grid, tmp_path / "ray", "--ray", cluster.address)
        deadline = time.monotonic() + 120
        while len(list((tmp_path / "ray").glob("cells/*/run/run.json"))) < 2 and time.monotonic() < deadline:
            time.sleep(0.02)
        started = list((tmp_path / "ray").glob("cells/*/run/run.json"))
        assert len(started) == 2  # one on each node, and neither is done
        assert not any((run.parent / "result.json").exists() for run in started)
        cluster.remove_node(doomed, allow_graceful=False)
        assert running.wait(timeout=300) == 0, running.stderr.read()
    finally:
        cluster.shutdown()
    assert start(grid, tmp_path / "local", "--workers", "1").wait(timeout=300) == 0
    assert rows(tmp_path / "ray") == rows(tmp_path / "local")
    assert len(rows(tmp_path / "ray")) == 4


def test_no_cluster_is_one_line(tmp_path):
    grid = tmp_path / "grid.toml"
    grid.write_text(GRID)
    running = start(grid, tmp_path / "out", "--ray", "127.0.0.1:1")
    assert running.wait(timeout=60) == 2
    assert "no Ray cluster at 127.0.0.1:1" in running.stderr.read().splitlines()[-1]
