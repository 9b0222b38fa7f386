from experiments.report.references import best


def test_the_reference_of_a_changed_robot_is_that_of_the_robot():
    assert best("Hopper-v5?vary.mass=1.4", 4000.0) == best("Hopper-v5", 10.0)
    assert best("dm_control/walker-walk-v0?vary.mass=1.4", 5.0)[0] == 1000
    assert best("HalfCheetah-v5?vary.gear=0.7", 100.0) == (4800.0, "Gymnasium's reward_threshold")
    assert best("HalfCheetah-v5", 6000.0) == (6000.0, "the best run in this matrix") == best("Ant-v5", 6000.0)
