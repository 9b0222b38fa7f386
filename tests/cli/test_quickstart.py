from pathlib import Path

import matplotlib.pyplot as plt

from tests.cli.commands import run_json


def test_the_core_balances_its_twin_untrained_both_runs_are_trained_and_two_poles_are_solved(capsys, tmp_path):
    found = run_json(capsys, "quickstart", "--out", tmp_path)
    twin = {policy["who"]: policy for policy in found["twin"]}
    assert list(twin) == ["core", "shuffled core", "random core", "random actions", "zero action"]
    assert min(twin["core"]["members"]) > 900
    assert len(twin["core"]["members"]) == 5
    assert max(policy["mean"] for who, policy in twin.items() if who != "core") < twin["core"]["low"]
    assert [(run["core"], run["env"], run["episodes"]) for run in found["runs"]] == [
        ("inverted-pendulum-v1", "InvertedDoublePendulum-v5", 200),
        (None, "InvertedDoublePendulum-v5", 200),
    ]
    assert {Path(run["run_dir"]).name for run in found["runs"]} == {"inverted-pendulum-v1", "scratch"}
    assert 0 < found["zero_action"]["mean"] < 200  # the poles fall
    assert found["solved"]["algo"] == "dyna-ddpg"
    assert found["solved"]["eval_return_mean"] > 9000  # an evaluation has reached 9300; of 9360
    assert min(plt.imread(found[name]).std() for name in ("picture", "solved_picture")) > 0.01
