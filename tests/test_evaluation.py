import re

import numpy as np
import pytest

from tests.toys import Counter
from transferkit import evaluate
from transferkit.errors import ConfigError, SettingError
from transferkit.evaluation import Evaluation, RandomPolicy, ZeroPolicy

IDP = "InvertedDoublePendulum-v5"


def test_evaluation_episodes_depend_on_their_number_alone():
    whole = evaluate(ZeroPolicy(1), IDP, episodes=12, seed=3)
    assert evaluate(ZeroPolicy(1), IDP, episodes=5, seed=3).returns == whole.returns[:5]
    assert evaluate(ZeroPolicy(1), IDP, episodes=5, seed=4).returns != whole.returns[:5]
    assert whole.scores()["return_low"] < whole.mean < whole.scores()["return_high"]


@pytest.mark.parametrize("shape", [(3,), (3, 1), (1, 3), (3, 7)])
def test_an_answer_has_a_row_of_actions_for_each_observation(shape):
    class Actor:
        def act(self, observation):
            return np.zeros(shape)

    message = rf"answered 3 observations with an array of shape {re.escape(str(shape))} and not \(3, 3\); return a row"
    with pytest.raises(ConfigError, match=message):
        evaluate(Actor(), "Hopper-v5", episodes=3)


def test_no_episode_is_no_evaluation():
    with pytest.raises(SettingError, match=r"^episodes=0 must be at least 1 and at most 1,000,000$"):
        evaluate(ZeroPolicy(1), IDP, episodes=0)


def test_returns_and_lengths_are_in_the_order_of_the_episodes():
    lengths = iter([3, 5])
    found = evaluate(ZeroPolicy(1), lambda: Counter(next(lengths)), episodes=2)
    assert found == Evaluation((3.0, 5.0), (3, 5))


def test_scores_by_hand():
    """Mean 2, deviation 1, and Student's t of 4.303 with two degrees of freedom over the root of 3."""
    scores = Evaluation((1.0, 2.0, 3.0), (1, 1, 1)).scores()
    assert (scores["return_mean"], scores["return_std"], scores["n"]) == (2.0, 1.0, 3)
    assert scores["return_high"] - 2.0 == pytest.approx(4.3027 / 3**0.5, rel=1e-4)
    assert 2.0 - scores["return_low"] == pytest.approx(4.3027 / 3**0.5, rel=1e-4)
    assert Evaluation((1.0,), (1,)).scores()["return_std"] == 0.0


def test_random_actions_are_repeatable_and_within_their_range():
    one, two = (RandomPolicy(2, seed=1).act(np.zeros((500, 3), np.float32)) for _ in range(2))
    assert np.array_equal(one, two)
    assert -1 <= one.min() < -0.9
    assert 0.9 < one.max() <= 1
