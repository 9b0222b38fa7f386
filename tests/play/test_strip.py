import numpy as np
import pytest

from transferkit.play.moment import Moment
from transferkit.play.strip import KEPT, PICTURES, _Roll, evenly_spaced


class Shutter:
    """Counts how often it takes a picture."""

    taken = 0

    def picture(self):
        self.taken += 1
        return np.zeros((4, 4, 3), np.uint8)


@pytest.mark.parametrize("steps", [1, 5, 8, 63, 64, 1000])
def test_pictures_of_an_episode_of_any_length_are_evenly_spaced_from_its_start_to_its_end(steps):
    shutter = Shutter()
    roll = _Roll(shutter, None)
    for step in range(steps + 1):
        roll.show(Moment(None, np.zeros(1), step, step * 0.1, last=step == steps))
    times = [shot.seconds for shot in evenly_spaced(roll.shots)]
    assert (times[0], times[-1]) == (0.0, pytest.approx(steps * 0.1))
    assert len(times) == min(PICTURES, steps + 1)
    assert np.ptp(np.diff(times)) <= 2 * max(0.1, steps * 0.1 / KEPT)
    assert len(roll.shots) <= 2 * KEPT
    assert shutter.taken <= 8 * KEPT
