import numpy as np

from experiments.report.curves import CORE_PLAYS, Arm, running_mean


def test_running_mean_is_of_what_is_there():
    np.testing.assert_allclose(running_mean(np.array([1.0, 3.0, 5.0, 7.0]), 2), [1.0, 2.0, 4.0, 6.0])
    assert running_mean(np.array([1e20, 3.0, 5.0]), 2)[-1] == 4.0


def test_the_share_of_runs_that_the_untrained_core_plays():
    """Two runs: the core plays to the end in one, and the first of three evaluations in the other."""
    arm = Arm("transfer", (), None)
    steps = {"episodes": np.array([0.0, 1.0, 2.0]), "steps": np.array([0.0, 10.0, 20.0]), "returns": np.zeros(3)}
    vars(arm)["evaluations"] = {(0, 0): {**steps, "core": np.ones(3)}, (0, 1): {**steps, "core": np.array([1.0, 0.0, 0.0])}}
    curve = arm.curve(CORE_PLAYS, "steps")
    np.testing.assert_allclose(np.interp([0.0, 5.0, 10.0, 20.0], curve.x, curve.middle), [1.0, 0.75, 0.5, 0.5], atol=0.01)
    arm = Arm("scratch", (), None)
    vars(arm)["evaluations"] = {(0, 0): {**steps, "core": np.zeros(3)}}
    assert arm.curve(CORE_PLAYS, "steps") is None
