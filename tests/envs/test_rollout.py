import itertools
from collections import deque

import gymnasium
import numpy as np
import pytest

from tests.toys import Counter
from transferkit.envs import NO_LIMIT, make_env, rollout
from transferkit.evaluation import ZeroPolicy


class Actor:
    """Acts by the seed and step that it sees, and notes how many episodes it was asked for at once."""

    def __init__(self):
        self.asked = []

    def act(self, observation):
        self.asked.append(len(observation))
        return (observation.sum(1, keepdims=True) / 100).astype(np.float32)


def play(actor, *lengths, **options):
    return rollout(actor, [make_env(Counter(length)) for length in lengths], lambda episode: 10 * episode, **options)


def test_episodes_run_side_by_side_each_from_its_own_seed():
    """Two environments with episodes of 2 and of 3 steps: the first that is free takes the next episode."""
    actor, started = Actor(), []
    steps = list(play(actor, 2, 3, episodes=4, on_reset=started.append))
    assert [(step.episode, step.step) for step in steps] == [
        (0, 0), (1, 0),
        (0, 1), (1, 1),
        (1, 2), (2, 0),
        (2, 1), (3, 0),
        (3, 1),
        (3, 2),
    ]  # fmt: skip
    assert started == [0, 1, 2, 3]
    assert actor.asked == [2, 2, 2, 2, 1, 1]
    for step in steps:
        assert step.observation.tolist() == [10 * step.episode, step.step]
        assert step.next_observation.tolist() == [10 * step.episode, step.step + 1]  # the true one at the end too
        assert step.action == np.float32((10 * step.episode + step.step) / 100)
        assert step.reward == 1.0
        assert step.done == step.terminated == (step.step + 1 == (2 if step.episode in (0, 2) else 3))


def test_a_step_is_seen_before_its_environment_is_reset():
    env = make_env(Counter(2))
    for step in rollout(Actor(), [env], lambda episode: episode, episodes=3):
        assert env.unwrapped.t == step.step + 1
        assert env.unwrapped.seed == step.episode


def test_without_a_number_of_episodes_the_caller_stops():
    assert [step.episode for step in itertools.islice(play(Actor(), 1), 5)] == [0, 1, 2, 3, 4]


def test_a_time_limit_truncates_and_does_not_terminate():
    env = make_env(gymnasium.wrappers.TimeLimit(Counter(9), 3))
    steps = list(rollout(Actor(), [env], lambda episode: episode, episodes=1))
    assert [(step.terminated, step.truncated) for step in steps] == [(False, False), (False, False), (False, True)]


def test_an_episode_without_end_is_given_up():
    (last,) = deque(rollout(ZeroPolicy(1), [make_env(Counter(10**9))], lambda _: 0, episodes=1), maxlen=1)
    assert (last.step + 1, last.terminated, last.truncated) == (NO_LIMIT, False, True)


def test_who_holds_an_action_is_asked_once_in_so_many_steps_of_each_episode():
    actor = Actor()
    actor.hold = 2
    steps = list(play(actor, 3, 2, episodes=3))
    by_episode = {k: [float(step.action[0]) for step in steps if step.episode == k] for k in range(3)}
    assert by_episode == {0: pytest.approx([0, 0, 0.02]), 1: pytest.approx([0.1, 0.1]), 2: pytest.approx([0.2, 0.2])}
    assert actor.asked == [2, 2]
