import gymnasium
import numpy as np
import pytest

from transferkit.envs import make_env
from transferkit.errors import EnvironmentContractError, UnknownNameError


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
