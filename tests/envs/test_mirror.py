"""Mirror images of robots, by hand; and that nothing is one that does not move alike."""

import numpy as np
import pytest
import torch

from transferkit import make_env
from transferkit.envs import find_mirror
from transferkit.streams import Streams
from transferkit.trainers.dyna.image import Image

WALKER, POLES = "Walker2d-v5", "InvertedDoublePendulum-v5"


def test_poles_fall_to_the_other_side():
    """Only the cosines keep their sign: the cart, sines, velocities and the force of the rail change theirs."""
    mirror = find_mirror(POLES)
    assert (mirror.action.index, mirror.action.sign) == ((0,), (-1.0,))
    assert mirror.observation.index == tuple(range(9))
    assert mirror.observation.sign == (-1, -1, -1, 1, 1, -1, -1, -1, -1)
    assert find_mirror(f"{POLES}?vary.frames=2").observation.sign == 2 * mirror.observation.sign  # and did before
    assert find_mirror("dm_control/cartpole-swingup-v0").observation.sign == (-1, 1, -1, -1, -1)


def test_legs_that_are_alike_change_places():
    mirror = find_mirror(WALKER)
    assert mirror.action.index == (3, 4, 5, 0, 1, 2)
    assert mirror.observation.index == (0, 1, 5, 6, 7, 2, 3, 4, 8, 9, 10, 14, 15, 16, 11, 12, 13)
    assert {*mirror.action.sign, *mirror.observation.sign} == {1.0}
    assert find_mirror("dm_control/walker-walk-v0").action.index == (3, 4, 5, 0, 1, 2)  # its legs stand beside each other


@pytest.mark.parametrize(
    ("env", "why"),
    [
        ("Hopper-v5", "a foot"),
        ("HalfCheetah-v5", "a head, and forward is what pays"),
        ("dm_control/reacher-easy-v0", "where the target is"),
        (f"{WALKER}?vary.dead_actuator=[0]", "one leg is lame"),
        (f"{WALKER}?vary.length.leg_left=1.2", "one leg is longer"),
        (f"{POLES}?vary.noise=0.1", "what is seen is never the same"),
        ("Ant-v5", "free joints are not looked at"),
        ("Pendulum-v1", "no MuJoCo"),
    ],
)
def test_what_does_not_move_alike_has_no_image(env, why):
    assert find_mirror(env) is None, why


def test_the_image_of_what_happens_is_what_happens_to_the_image():
    """From a start to the one in the mirror; ten steps, not those of the search."""
    mirror = find_mirror(POLES)
    rng, envs = np.random.default_rng(7), [make_env(POLES) for _ in range(2)]
    for env in envs:
        env.reset(seed=3)
    image = envs[1].unwrapped
    image.set_state(-envs[0].unwrapped.data.qpos, -envs[0].unwrapped.data.qvel)
    for action in rng.uniform(-1, 1, (10, 1)).astype(np.float32):
        one, other = envs[0].step(action), envs[1].step(mirror.action(action).astype(np.float32))
        np.testing.assert_allclose(other[0], mirror.observation(one[0]), atol=1e-4)
        assert other[1] == pytest.approx(one[1], abs=1e-6)


def test_about_half_of_the_rows_become_their_images():
    """Rows of two observations, an action, a reward, two observations and an end."""
    mirror = find_mirror("InvertedPendulum-v5")
    assert mirror is None  # its pole leans a millimetre
    mirror = find_mirror("dm_control/pendulum-swingup-v0")
    row = torch.tensor([0.6, 0.8, -3.0, 0.5, 1.0, 0.7, 0.71, -2.0, 0.0])
    image = torch.tensor([0.6, -0.8, 3.0, -0.5, 1.0, 0.7, -0.71, 2.0, 0.0])
    rows = Image(mirror, torch.device("cpu")).of_half(row.expand(4, 250, 9), Streams(0).torch("x"))
    turned = (rows == image).all(-1)
    assert (turned | (rows == row).all(-1)).all()
    assert 430 < int(turned.sum()) < 570
