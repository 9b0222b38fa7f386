import numpy as np
import pytest

from tests.toys import Counter
from transferkit.envs import VectorEnv, make_env
from transferkit.errors import NotFiniteError


def make(*lengths):
    return VectorEnv([make_env(Counter(length)) for length in lengths], lambda i, k: 10 * i + k)


def test_an_ended_episode_is_reset_in_the_same_step():
    envs = make(1, 3)
    assert envs.reset().tolist() == [[0, 0], [10, 0]]
    step = envs.step(np.zeros((2, 1), np.float32))
    assert step.final_observation.tolist() == [[0, 1], [10, 1]]
    assert step.observation.tolist() == [[1, 0], [10, 1]]
    assert step.done.tolist() == [True, False]


def test_a_budget_can_end_between_two_environments():
    envs = make(5, 5, 5)
    envs.reset()
    booked = []
    step = envs.step(np.zeros((3, 1), np.float32), lambda i, reward, **ends: booked.append((i, reward, ends)) or i == 1)
    assert booked == [(i, 1.0, {"terminated": False, "truncated": False}) for i in (0, 1)]
    assert len(step.reward) == 2
    assert [env.unwrapped.t for env in envs.envs] == [1, 1, 0]


def test_restoring_replays_the_running_episodes_to_the_bit():
    ids = ("Hopper-v5", "dm_control/finger-turn_hard-v0")
    for env_id in ids:
        envs, twin = (VectorEnv([make_env(env_id) for _ in range(2)], lambda i, k: 7 + i + 10 * k) for _ in range(2))
        envs.reset()
        rng = np.random.default_rng(0)
        shape = (2, *envs.envs[0].action_space.shape)
        for _ in range(60):
            last = envs.step(rng.uniform(-1, 1, shape).astype(np.float32))
        np.testing.assert_array_equal(twin.restore(envs.state()), last.observation)
        action = rng.uniform(-1, 1, shape).astype(np.float32)
        np.testing.assert_array_equal(envs.step(action).final_observation, twin.step(action).final_observation)


def test_nan_stops_with_the_step():
    envs = VectorEnv([make_env(Counter(9, bad_at=2))], lambda *_: 0)
    envs.reset()
    envs.step(np.zeros((1, 1), np.float32))
    with pytest.raises(NotFiniteError, match="Counter returned an observation or a reward with NaN or infinity in step 2"):
        envs.step(np.zeros((1, 1), np.float32))


def test_a_held_action_is_one_step_of_their_summed_rewards_and_ends_with_its_episode():
    envs = VectorEnv([make_env(Counter(5))], lambda _, episode: episode, hold=3)
    envs.reset()
    booked = []
    first, second = (
        envs.step(np.ones((1, 1), np.float32), lambda *given, **ends: booked.append((given, ends))) for _ in range(2)
    )
    assert (first.reward.tolist(), first.observation.tolist(), first.done.tolist()) == ([3.0], [[0, 3]], [False])
    assert (second.reward.tolist(), second.final_observation.tolist(), second.terminated.tolist()) == ([2.0], [[0, 5]], [True])
    assert second.observation.tolist() == [[1, 0]]
    assert [given for given, _ in booked] == [(0, 1.0)] * 5
    assert envs.state() == {"episode": [1], "actions": [[]]}


def test_a_budget_can_end_within_a_held_action():
    envs = VectorEnv([make_env(Counter(9)) for _ in range(2)], lambda i, _: i, hold=4)
    envs.reset()
    step = envs.step(np.zeros((2, 1), np.float32), lambda i, reward, **ends: envs.envs[0].unwrapped.t == 2)
    assert step.reward.tolist() == [2.0]
    assert [env.unwrapped.t for env in envs.envs] == [2, 0]
