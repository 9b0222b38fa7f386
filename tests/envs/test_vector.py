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
