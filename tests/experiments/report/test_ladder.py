import pytest

from experiments.report.ladder import CONTROL, ORDER, RUNGS, rung_of


@pytest.mark.parametrize(
    ("source", "target", "rung"),
    [
        ("HalfCheetah-v5", "dm_control/cheetah-run-v0", "2"),
        ("Walker2d-v5", "Walker2d-v5?vary.mass=1.4", "4"),
        ("Walker2d-v5", "Walker2d-v5?vary.mass=1.4&vary.dead_actuator=[0]", "5"),
        ("Hopper-v5", "Walker2d-v5", "7"),
        ("Hopper-v5?vary.mass=[0.7,1.3]", "Walker2d-v5", "7"),
        ("InvertedPendulum-v5", "Hopper-v5", CONTROL),
        ("Walker2d-v5", "Walker2d-v5", "-"),
        ("Walker2d-v5", "Hopper-v5", "-"),
    ],
)
def test_a_pair_stands_on_one_rung(source, target, rung):
    assert rung_of(source, target) == rung


def test_every_rung_has_its_place_and_no_pair_stands_on_two():
    assert {*RUNGS, "4", "5", "-"} == {*ORDER}
    pairs = [pair for rung in RUNGS.values() for pair in rung]
    assert len(pairs) == len({*pairs})
