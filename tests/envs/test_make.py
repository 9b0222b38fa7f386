import gymnasium
import numpy as np
import pytest

from tests.toys import Counter
from transferkit.envs import derive_spec, make_env, solved_return, vary
from transferkit.errors import EnvironmentContractError, NotFiniteError, SettingError, UnknownNameError
from transferkit.evaluation import ZeroPolicy, evaluate


def test_unknown_names_get_a_suggestion():
    with pytest.raises(UnknownNameError, match="did you mean Hopper-v5"):
        make_env("Hoper-v5")
    with pytest.raises(UnknownNameError, match="'Hopper'; did you mean Hopper-v"):  # which one would be another some day
        make_env("Hopper")
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
            "huge reward": (observation, 1e39, terminated, truncated, info),
            "numeral": (observation, "1.5", terminated, truncated, info),
            "rewards": (observation, np.ones(1), terminated, truncated, info),
            "truncated": (observation, reward, terminated, "no", info),
            "terminated": (observation, reward, None, truncated, info),
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
        ("huge reward", NotFiniteError, r"the reward 1e\+39 in step 1 of an episode, beyond 1e\+30; scale its rewards"),
        ("numeral", EnvironmentContractError, "a value of type str for reward, and not a number"),
        ("rewards", EnvironmentContractError, r"an array of shape \(1,\) for reward, and not a number"),
        ("truncated", EnvironmentContractError, "a value of type str for truncated, and not True or False"),
        ("terminated", EnvironmentContractError, "a value of type NoneType for terminated, and not True or False"),
    ],
)
@pytest.mark.filterwarnings("ignore::RuntimeWarning")
def test_what_an_environment_must_not_do_is_one_line_in_evaluation_too(fault, kind, message):
    with pytest.raises(kind, match=message) as error:
        evaluate(ZeroPolicy(1), lambda: Bad(fault), episodes=1)
    assert "\n" not in str(error.value)


@pytest.mark.parametrize("number", [np.nan, np.inf])
def test_a_policy_that_answers_no_number_is_named(number):
    env = make_env(Counter(5))
    env.reset(seed=0)
    with pytest.raises(NotFiniteError, match="the policy chose an action with NaN or infinity"):
        env.step(np.array([number], np.float32))


@pytest.mark.parametrize(
    ("low", "high", "kind"), [(-0.2, 2.3, float), (-0.2, 2.3, np.float32), (-3, 4, int), (0, 255, np.uint8)]
)
def test_actions_are_of_their_space(low, high, kind):
    class Bounded(Counter):
        action_space = gymnasium.spaces.Box(low, high, (1,), kind)

        def step(self, action):
            assert self.action_space.contains(action)
            taken.append(float(action[0]))
            return super().step(action)

    taken = []
    env = make_env(Bounded(5))
    env.reset(seed=0)
    for action in (-1.0, 1.0, 0.3):  # 1.05 - 1.25 is -0.2 and an ulp
        env.step(np.array([action], np.float32))
    middle = (low + high) / 2 + 0.3 * (high - low) / 2
    assert taken == pytest.approx([low, high, np.rint(middle) if np.issubdtype(kind, np.integer) else middle])


def test_a_bound_that_is_no_number_is_refused():
    class Unbound(Counter):
        action_space = gymnasium.spaces.Box(-1.0, 1.0, (1,))

    env = Unbound(5)
    env.action_space.low[0] = np.nan
    with pytest.raises(EnvironmentContractError, match="action 0 of Unbound has bounds nan to 1"):
        make_env(env)


def test_no_id_opens_a_window():
    with pytest.raises(EnvironmentContractError, match="sets render_mode; leave it out"):
        make_env("InvertedPendulum-v5?render_mode=human")


def test_an_episode_is_truncated_where_the_user_says(caplog):
    lengths = evaluate(ZeroPolicy(1), lambda: Counter(10**9), episodes=2, max_episode_steps=7).lengths
    assert lengths == (7, 7)
    assert not caplog.records


@pytest.mark.parametrize("env_id", ["a:b:c", ":X", "..:X", "no such module:X-v0", "a-b:X"])
def test_an_id_that_is_none_is_one_line(env_id):
    with pytest.raises(EnvironmentContractError) as error:
        make_env(env_id)
    assert "\n" not in str(error.value)


SAID = {
    "spec": (property(lambda self: 1 / 0), "failed in what it says of itself with ZeroDivisionError"),
    "unwrapped": (property(lambda self: 1 / 0), "failed in what it says of itself with ZeroDivisionError"),
    "episode_limit": (property(lambda self: 1 / 0), "failed in what it says of itself with ZeroDivisionError"),
    **{f"episode_limit {limit}": (limit, f"the episode limit of Odd={limit!r} must be") for limit in (20.0, "20", 0, -5)},
    "episode_limit method": (lambda self: 20, "the episode limit of Odd='method' must be"),
}


@pytest.mark.parametrize("name", SAID)
def test_what_an_environment_says_of_itself_is_checked_before_a_step(name):
    value, message = SAID[name]
    odd = type("Odd", (Counter,), {name.partition(" ")[0]: value})
    with pytest.raises(EnvironmentContractError, match=message) as error:
        make_env(lambda: odd(5))
    assert "\n" not in str(error.value)


def test_what_solves_a_task_is_a_number_or_not_known(caplog):
    class Solved(Counter):
        spec = gymnasium.envs.registration.EnvSpec("Solved-v0", reward_threshold=7)

    assert solved_return(make_env(Solved(5))) == 7.0
    for threshold in ("7", 10**400, float("nan")):
        Solved.spec.reward_threshold = threshold
        assert solved_return(make_env(Solved(5))) is None
        assert "reward_threshold" in caplog.messages[-1]


def test_elsewhere_than_in_gymnasiums_robots_actions_have_the_type_of_their_space():
    class Exact(Counter):
        def step(self, action):
            assert self.action_space.contains(action)
            return super().step(action)

    make_env(env := Exact(5)).reset(seed=0)
    make_env(env).step(np.zeros(env.action_space.shape))


def test_the_bounds_are_those_that_a_clip_further_in_clips_to():
    clipped = gymnasium.wrappers.RecordEpisodeStatistics(gymnasium.wrappers.ClipAction(gymnasium.make("Hopper-v5")))
    assert make_env(clipped).high.tolist() == [1.0] * 3
    assert make_env(vary(gymnasium.wrappers.ClipAction(gymnasium.make("Hopper-v5")), mass=1.3)).high.tolist() == [1.0] * 3


def test_what_a_wrapper_has_learnt_is_left_as_it_was():
    class Mean(gymnasium.Wrapper):
        total, inplace = np.zeros(4), np.zeros(4)

        def step(self, action):
            result = self.env.step(action)
            self.total = self.total + result[0]
            self.inplace += result[0]
            return result

    env = Mean(gymnasium.make("InvertedPendulum-v5"))
    env.inplace = env.inplace.copy()
    env.reset(seed=0)
    env.step(env.action_space.sample())
    before = env.total.copy(), env.inplace.copy()
    derive_spec(env)
    np.testing.assert_array_equal((env.total, env.inplace), before)


def test_an_environment_that_ends_for_good_is_known():
    class Final(gymnasium.Wrapper):
        def reset(self, **given):
            self.over = False
            return self.env.reset(**given)

        def step(self, action):
            assert not self.over
            result = self.env.step(action)
            self.over = result[2] or result[3]
            return result

    spec = derive_spec(lambda: Final(gymnasium.make("InvertedPendulum-v5", max_episode_steps=4)))
    assert [element.quantity for element in spec.observation] == ["position", "position", "velocity", "velocity"]


def test_a_limit_below_one_is_refused():
    for limit in (0, -1, "a"):
        with pytest.raises(SettingError, match="max_episode_steps"):
            make_env("InvertedPendulum-v5", max_episode_steps=limit)


def test_bounds_without_room_or_with_too_much_are_one_line():
    for high, message in ((-1e308, "cannot do anything"), (1e308, r"bounds -1e\+308 to 1e\+308, too far apart")):
        wide = type("Wide", (Counter,), {"action_space": gymnasium.spaces.Box(-1e308, high, (1,), np.float64)})
        with pytest.raises(EnvironmentContractError, match=message):
            make_env(lambda wide=wide: wide(5))
