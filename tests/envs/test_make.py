import gymnasium
import numpy as np
import pytest

from tests.toys import Counter
from transferkit.envs import make_env
from transferkit.errors import EnvironmentContractError, NotFiniteError, UnknownNameError
from transferkit.evaluation import ZeroPolicy, evaluate


def test_unknown_names_get_a_suggestion():
    with pytest.raises(UnknownNameError, match="did you mean Hopper-v5"):
        make_env("Hoper-v5")
    with pytest.raises(UnknownNameError, match="did you mean dm_control/cartpole-balance-v0"):
        make_env("dm_control/cartpole-balanc-v0")


@pytest.mark.parametrize("env_id", ["CartPole-v1", "Taxi-v4"])
def test_discrete_spaces_are_refused(env_id):
    with pytest.raises(EnvironmentContractError, match=r"space of .*=Discrete\(.*\) must be a flat") as error:
        make_env(env_id)
    assert error.value.topic == "environments"  # the command line knows where they are listed


def test_images_and_unbounded_actions_are_refused():
    class Pixels(gymnasium.Env):
        observation_space = gymnasium.spaces.Box(0, 255, (8, 8, 3), np.uint8)
        action_space = gymnasium.spaces.Box(-1, 1, (1,))

    with pytest.raises(EnvironmentContractError, match=r"observation space of Pixels=Box\(0, 255, .* must be a flat Box$"):
        make_env(Pixels())
    Pixels.observation_space = gymnasium.spaces.Box(-1, 1, (3,))
    Pixels.action_space = gymnasium.spaces.Box(-np.inf, np.inf, (1,))
    with pytest.raises(
        EnvironmentContractError, match=r"action space of Pixels=Box\(-inf, inf, .* must be a flat and bounded Box$"
    ):
        make_env(Pixels())


def test_actions_are_scaled_to_the_bounds_and_clipped():
    env = make_env("InvertedPendulum-v5")
    env.reset(seed=0)
    env.step(np.array([0.5], np.float32))
    assert env.unwrapped.data.ctrl[0] == 1.5
    env.step(np.array([-7.0], np.float32))
    assert env.unwrapped.data.ctrl[0] == -3.0


def test_an_environment_under_the_contract_keeps_it_and_can_be_asked_not_to_clip():
    clipped = make_env("InvertedPendulum-v5")
    assert make_env(clipped) is clipped
    unclipped = make_env(clipped, clip_actions=False)
    assert make_env(unclipped, clip_actions=False) is unclipped
    assert make_env(unclipped) is unclipped
    for env, newtons in ((clipped, 3.0), (unclipped, 6.0)):
        env.reset(seed=0)
        env.step(np.array([2.0]))
        assert env.unwrapped.data.ctrl == [newtons]


class Bad(Counter):
    """A counter with a fault of a kind."""

    def __init__(self, fault):
        super().__init__(5)
        self.fault = fault

    def step(self, action):
        if self.fault == "raises":
            raise KeyError("robot")
        observation, reward, terminated, truncated, info = super().step(action)
        return {
            "shape": (np.zeros(7), reward, terminated, truncated, info),
            "too few": (observation, reward, terminated),
            "reward": (observation, "much", terminated, truncated, info),
            "nan reward": (observation, float("nan"), terminated, truncated, info),
            "nan observation": (observation * np.nan, reward, terminated, truncated, info),
            "huge observation": (observation * 0 + 1e300, reward, terminated, truncated, info),
            "info": (observation, reward, terminated, truncated, None),
        }[self.fault]


@pytest.mark.parametrize(
    ("fault", "kind", "message"),
    [
        ("raises", EnvironmentContractError, r"failed in step 1 with KeyError: 'robot' \(test_make.py, line \d+\)"),
        ("shape", EnvironmentContractError, r"an observation of shape \(7,\)"),
        ("too few", EnvironmentContractError, "step of Bad returned 3 and not 5 values: observation, reward"),
        ("reward", EnvironmentContractError, "could not convert string to float"),
        ("nan reward", NotFiniteError, "NaN or infinity in step 1"),
        ("nan observation", NotFiniteError, "NaN or infinity in step 1"),
        ("huge observation", NotFiniteError, "NaN or infinity in step 1"),
        ("info", EnvironmentContractError, "info of type NoneType"),
    ],
)
@pytest.mark.filterwarnings("ignore::RuntimeWarning")
def test_what_an_environment_must_not_do_is_one_line_in_evaluation_too(fault, kind, message):
    with pytest.raises(kind, match=message) as error:
        evaluate(ZeroPolicy(1), lambda: Bad(fault), episodes=1)
    assert "\n" not in str(error.value)


def test_a_policy_that_answers_nan_is_named():
    env = make_env(Counter(5))
    env.reset(seed=0)
    with pytest.raises(NotFiniteError, match="the policy chose an action with NaN"):
        env.step(np.array([np.nan], np.float32))


def test_an_episode_is_truncated_where_the_user_says(caplog):
    lengths = evaluate(ZeroPolicy(1), lambda: Counter(10**9), episodes=2, max_episode_steps=7).lengths
    assert lengths == (7, 7)
    assert not caplog.records


@pytest.mark.parametrize("env_id", ["a:b:c", ":X", "..:X", "no such module:X-v0", "a-b:X"])
def test_an_id_that_is_none_is_one_line(env_id):
    with pytest.raises(EnvironmentContractError) as error:
        make_env(env_id)
    assert "\n" not in str(error.value)
