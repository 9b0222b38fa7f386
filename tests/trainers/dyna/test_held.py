from dataclasses import replace

import numpy as np
import pytest
import torch

from tests.trainers.dyna.test_agent import make_agent
from transferkit.config import DynaConfig
from transferkit.envs import Step
from transferkit.nn import Architecture
from transferkit.policy.base import ScratchPolicy
from transferkit.reading import FormatError
from transferkit.streams import Streams
from transferkit.trainers.dyna.held import held_transitions
from transferkit.trainers.dyna.replay import Batch


def test_the_steps_of_an_action_follow_from_the_time_step():
    config = DynaConfig(hold_seconds=0.03)
    assert [config.hold_steps(time_step) for time_step in (0.008, 0.01, 0.025, 0.05, 0.0)] == [4, 3, 1, 1, 1]
    assert DynaConfig().hold_steps(0.008) == 1
    assert replace(config, discount_seconds=None, gamma=0.97).discount(0.008) ** 4 == pytest.approx(0.97)  # per action


def observe(agent, observation, reward, *, terminated=False, truncated=False):
    row = lambda x: np.full((1, 4), x, np.float32)  # noqa: E731
    action = agent.explore(row(observation))
    flags = np.array([terminated]), np.array([truncated])
    agent.observe(row(observation), action, Step(row(9.0), np.array([reward], np.float32), *flags, row(observation + 1)))
    return float(action[0, 0])


@pytest.fixture
def agent(pendulum_spec):
    architecture = Architecture(4, 1, (16, 16), "relu")
    policy = ScratchPolicy.create(architecture, Streams(0).torch("policy"), init_std=1.0, normalize=True)
    config = DynaConfig(batch_size=8, random_steps=0, hold_seconds=0.03, discount_seconds=0.01 / np.log(2))  # 0.5 a step
    return make_agent(policy, pendulum_spec, config, time_step=0.01)


def test_an_action_is_held_and_its_steps_are_one_transition(agent):
    actions = [observe(agent, k, 2.0**k) for k in range(4)]
    assert actions[0] == actions[1] == actions[2] != actions[3]
    assert agent.discount == pytest.approx(0.125)
    (reward,) = agent.buffer.all().reward.tolist()
    assert reward == 1 + 2 / 2 + 4 / 4
    assert agent.buffer.all().observation[0, 0] == 0
    assert agent.buffer.all().next_observation[0, 0] == 3
    for k in range(4, 6):
        observe(agent, k, 0.0)
    assert agent.buffer.state()["weights"].tolist() == [1, 0.125]  # by the time since the episode began


def test_an_episode_ends_the_holding_and_what_the_time_limit_cuts_is_left_out(agent):
    observe(agent, 0, 1.0)
    observe(agent, 1, 1.0, terminated=True)
    observe(agent, 0, 5.0)
    observe(agent, 1, 5.0, truncated=True)
    for _ in range(3):
        observe(agent, 0, 7.0)
    assert agent.buffer.all().reward.tolist() == [1.5, 7 * 1.75]
    assert agent.buffer.all().terminated.tolist() == [1.0, 0.0]


def test_an_agent_goes_on_in_the_middle_of_an_action(agent, pendulum_spec):
    observe(agent, 0, 1.0)
    other = make_agent(agent.policy, pendulum_spec, agent.config, time_step=0.01)
    other.restore(agent.state())
    assert observe(agent, 1, 1.0) == observe(other, 1, 1.0)
    assert (other.steps, len(other.buffer)) == (2, 0)


def test_transitions_of_elsewhere_are_joined_as_if_the_mean_of_their_actions_was_held():
    """Observations 0 to 4 in an episode that terminates, then 10 to 12 in one that is cut."""
    first, second = torch.arange(5.0), torch.arange(10.0, 13.0)
    observation = torch.cat((first, second))[:, None]
    terminated = torch.zeros(8)
    terminated[4] = 1.0
    joined, weights = held_transitions(Batch(observation, observation * 2, torch.ones(8), observation + 1, terminated), 3, 0.5)
    assert joined.observation.flatten().tolist() == [0, 1, 2, 3, 4, 10]
    assert joined.action.flatten().tolist() == [2, 4, 6, 7, 8, 22]  # of 0, 2, 4, then of 2, 4, 6, and so on
    assert joined.reward.tolist() == [1.75, 1.75, 1.75, 1.5, 1.0, 1.75]
    assert joined.next_observation.flatten().tolist() == [3, 4, 5, 5, 5, 13]
    assert joined.terminated.tolist() == [0, 0, 1, 1, 1, 0]
    assert weights.tolist() == [1, 0.5, 0.25, 0.125, 0.0625, 1]  # of the time since the episode began


def test_an_action_is_not_credited_with_what_others_did():
    """Rewards are the actions: those that take turns are worth nothing together, and one that is held is worth itself."""
    time = torch.arange(12.0)[:, None]
    turns, held = 1.0 - 2.0 * (time % 2), torch.tensor([1.0] * 6 + [-1.0] * 6)[:, None]
    for action in (turns, held):
        joined, _ = held_transitions(Batch(time, action, action[:, 0], time + 1, torch.zeros(12)), 2, 1.0)
        torch.testing.assert_close(joined.reward, 2 * joined.action[:, 0])


def test_what_is_shorter_than_an_action_is_no_transition(agent):
    agent.remember(Batch(torch.zeros(2, 4), torch.zeros(2, 1), torch.ones(2), torch.zeros(2, 4), torch.zeros(2)))
    assert len(agent.buffer) == 0
    agent.learn()


@pytest.mark.parametrize("change", [{"age": -1}, {"reward": None}, {"action": [[1.0, 2.0]]}, {"observation": [0.0] * 4}])
def test_a_forged_held_action_is_refused(agent, change):
    observe(agent, 0, 1.0)
    state = agent.state()
    state["held"] = [state["held"][0] | change]
    with pytest.raises(FormatError):
        agent.restore(state)
