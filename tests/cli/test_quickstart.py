from pathlib import Path

import matplotlib.pyplot as plt

from tests.cli.commands import run_json


def test_a_core_balances_its_twin_untrained_another_gets_a_robot_going_and_one_is_refused(capsys, tmp_path):
    found = run_json(capsys, "quickstart", "--out", tmp_path)
    twin = {policy["who"]: policy for policy in found["twin"]}
    assert list(twin) == ["core", "shuffled core", "random core", "random actions", "zero action"]
    assert min(twin["core"]["members"]) > 900
    assert len(twin["core"]["members"]) == 5
    assert max(policy["mean"] for who, policy in twin.items() if who != "core") < twin["core"]["low"]
    core, scratch = found["runs"]
    assert [(run["core"], run["env"]) for run in found["runs"]] == [("hopper-v1", "Walker2d-v5"), (None, "Walker2d-v5")]
    assert {Path(run["run_dir"]).name for run in found["runs"]} == {"hopper-v1", "scratch"}
    assert core["eval_return_mean"] > 1.5 * scratch["eval_return_mean"] > 0
    assert max(run["steps"] for run in found["runs"]) == 20_000
    assert 0 < found["zero_action"]["mean"] < 200  # the walker falls
    assert found["refused"].startswith("refused: not clearly better than doing nothing")
    poles = found["poles"]
    assert (poles["core"], poles["env"], poles["algo"]) == (None, "InvertedDoublePendulum-v5", "dyna-ddpg")
    assert poles["eval_return_mean"] > 9000
    assert min(plt.imread(found[name]).std() for name in ("picture", "poles_picture")) > 0.01
