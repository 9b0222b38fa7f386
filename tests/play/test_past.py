import numpy as np
import pytest

from transferkit.play.moment import Inputs, Moment
from transferkit.play.past import Past


def moment(seconds, *observation):
    return Moment(None, np.array(observation, np.float32), 0, seconds, last=False)


def past_of(count):
    return Past(Inputs([f"x{k}" for k in range(count)], of_core=False, policy=None))


def test_each_input_is_scaled_to_its_largest_value_so_far_and_three_seconds_are_kept():
    past = past_of(2)
    for seconds, *observation in ((0.0, 4.0, 0.0), (1.0, -1.0, 0.0), (2.0, 2.0, 0.0), (3.5, 1.0, 0.0)):
        past.add(moment(seconds, *observation))
    assert past.times() == pytest.approx([-2.5, -1.5, 0.0])
    assert past.shares() == pytest.approx(np.array([[-0.25, 0.0], [0.5, 0.0], [0.25, 0.0]]))  # the 4 is past, its scale is not
    assert past.values == pytest.approx([1.0, 0.0])


def test_a_new_episode_has_no_past():
    past = past_of(1)
    past.add(moment(0.5, 1.0))
    past.add(moment(0.0, 1.0))
    assert past.times() == pytest.approx([0.0])


def test_no_more_inputs_are_drawn_than_can_be_told_apart():
    past = past_of(30)
    past.add(moment(0.0, *range(30)))
    assert (len(past.names), past.shares().shape, past.title) == (12, (1, 12), "observation, first 12 of 30")
