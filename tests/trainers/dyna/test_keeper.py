import copy

import pytest
import torch

from tests.toys import Half
from transferkit.trainers.dyna.keeper import Keeper


class Numbered(Half):
    """A policy that is told from others by a number."""

    def __init__(self):
        super().__init__()
        self.number = torch.nn.Parameter(torch.zeros(()))


def keeper(every=2):
    live = {"policy": Numbered()}
    made = Keeper(live, copy.deepcopy(live), copy.deepcopy(live), every)
    return made, live["policy"].number


def play(made, number, value, total):
    """Play an episode of this return while the policy that learns becomes `value`; returns who is kept."""
    with torch.no_grad():
        number.fill_(value)
    made.add(total - 1.0, done=False)
    made.add(1.0, done=True)
    return float(made.kept["policy"].number)


def test_a_policy_is_kept_when_two_episodes_confirm_that_it_is_better():
    made, number = keeper()
    assert not made.acts
    assert [play(made, number, 1, 50.0), play(made, number, 2, 60.0)] == [0, 0]  # with noise: no claim to anything
    assert made.acts  # episode 2 is played by number 2
    assert [play(made, number, 3, 10.0), play(made, number, 4, 8.0)] == [0, 2]  # its score is 8
    assert float(made.candidate["policy"].number) == 4
    assert made.acts
    assert play(made, number, 5, 8.0) == 2  # no better
    assert not made.acts
    assert play(made, number, 6, 99.0) == 2
    assert [play(made, number, 7, 9.0), play(made, number, 8, 20.0)] == [2, 6]  # as it was at the start of its first episode


def test_until_a_policy_is_assessed_the_newest_is_kept():
    made, number = keeper()
    play(made, number, 1, 5.0)
    made.follow()
    assert float(made.kept["policy"].number) == 1
    for value in (2, 3, 4):
        play(made, number, value, 5.0)
    made.follow()
    assert float(made.kept["policy"].number) == 2


@pytest.mark.parametrize("played", range(5))
def test_it_goes_on_from_its_state(played):
    (one, number), (two, other) = keeper(), keeper()
    returns = [1.0, 2.0, 3.0, 2.5, 4.0, 1.0, 7.0, 8.0, 9.0]
    for k in range(played):
        play(one, number, k, returns[k])
    two.restore(one.state())
    with torch.no_grad():
        other.copy_(number)
    for k in range(played, len(returns)):
        assert play(one, number, k, returns[k]) == play(two, other, k, returns[k])
