import numpy as np

from tests.play.test_camera import Drawn
from transferkit.play.camera import Camera
from transferkit.play.curves import WIDTH
from transferkit.play.film import LEAST_HEIGHT, _WithCurves
from transferkit.play.moment import Inputs, Moment


def test_the_inputs_are_beside_the_picture_and_move():
    beside = _WithCurves(Camera(Drawn(3)), Inputs(["x", "y"], of_core=False, policy=None))
    first, second = (
        beside.draw(Moment(None, np.array([k, -k], np.float32), k, 0.5 * k, last=False)).astype(int) for k in (0, 1)
    )
    assert first.shape == (LEAST_HEIGHT, 30 * LEAST_HEIGHT // 20 + WIDTH, 3)
    picture = np.s_[:, :-WIDTH]
    assert np.array_equal(first[picture], second[picture])
    assert (first != second).sum() > 100


def test_without_inputs_the_picture_is_as_it_is():
    assert _WithCurves(Camera(Drawn(3)), None).draw(Moment(None, np.zeros(2), 0, 0.0, last=False)).shape == (20, 30, 3)
