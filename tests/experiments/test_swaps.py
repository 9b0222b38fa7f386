"""What keeps a core from a target, by swaps on its own robot."""

import numpy as np
import pytest

from experiments.swaps import main, swaps
from transferkit.envs import derive_spec, make_env, open_simulation
from transferkit.matching import compiled, limits, pair

WALKER, SUITE = "Walker2d-v5", "dm_control/walker-walk-v0"


def model():
    return open_simulation(make_env(WALKER)).model


def test_each_swap_puts_one_thing_of_the_target_into_the_robot_of_the_core():
    source, target = derive_spec(WALKER), derive_spec(SUITE)
    found = swaps(compiled(pair(source, target), source, target), source, target)
    hips, knees, ankles = (f"{what}_joint, {what}_left_joint" for what in ("thigh", "leg", "foot"))
    hip, ankle = f"13% of the range of {hips}", f"14% of the force of {ankles}"
    assert list(found) == [
        "nothing",
        hip,
        f"36% of the force of {knees}",
        ankle,
        "a friction of 0.7 instead of 1.9",
        "all of these",
    ]
    own, changed, weak, every = model(), model(), model(), model()
    found[hip](changed)
    found[ankle](weak)
    found["all of these"](every)
    thigh = changed.joint("thigh_joint").id
    np.testing.assert_allclose(np.degrees(changed.jnt_range[thigh]), [-20, 100], atol=1e-3)  # which is the suite's hip
    np.testing.assert_array_equal(changed.actuator_gear, own.actuator_gear)
    np.testing.assert_allclose(weak.actuator_gear[:, 0], [100, 100, 14.43, 100, 100, 14.43], atol=0.01)  # 20, for its weight
    np.testing.assert_allclose(every.jnt_range[thigh], changed.jnt_range[thigh])
    assert every.geom_friction[:, 0].max() == pytest.approx(0.7)


def test_a_motor_that_drives_two_limbs_is_weakened_once():
    source, target = derive_spec("Hopper-v5"), derive_spec("HalfCheetah-v5?vary.mass=1.4")
    match = compiled(pair(source, target), source, target)
    found = swaps(match, source, target)
    weakest = {one.name: one.share for one in limits(match, source, target) if one.kind == "action"}
    every = open_simulation(make_env("Hopper-v5")).model
    found["all of these"](every)
    rows = {one.name: row for one, row in zip(target.action, match.action_weight, strict=True)}
    for k in range(source.act_dim):
        shares = [share for name, share in weakest.items() if any(rows[name][k :: source.act_dim])]
        assert every.actuator_gear[k, 0] == pytest.approx(200 * min(shares, default=1.0))


def test_what_cannot_be_swapped_is_one_line(capsys):
    assert main(["hopper-v1", "Pendulum-v1"]) == 2
    assert "Pendulum-v1 has no MuJoCo model" in capsys.readouterr().err


def test_a_core_is_played_with_each(capsys):
    assert main(["inverted-pendulum-v1", "dm_control/cartpole-balance-v0", "--members", "0", "--episodes", "1"]) == 0
    text = capsys.readouterr().out
    assert "nothing" in text
    assert "39% of the force of slider" in text
