from dataclasses import replace

import numpy as np
import pytest
import torch

from transferkit import wrap
from transferkit.config import DynaConfig, ModelConfig
from transferkit.envs import Step
from transferkit.nn import Architecture
from transferkit.policy.base import ScratchPolicy
from transferkit.policy.critic_and_model import make_critic, make_dynamics
from transferkit.streams import Streams
from transferkit.trainers.dyna.agent import Agent
from transferkit.trainers.dyna.replay import Batch

TINY = DynaConfig(batch_size=8, random_steps=0, model_share=0.0)
MODEL = ModelConfig(hidden=(16,))


def make_agent(policy, spec, config, *, model=MODEL, wrapped=False, compiles=False, time_step=0.0):
    streams = Streams(0)
    critic = make_critic(policy, config, (16, 16), streams.torch("critic"), wrapped=wrapped)
    dynamics = make_dynamics(policy, spec, model, streams.torch("model"))
    options = {"time_step": time_step, "compiles": compiles}
    return Agent(policy, critic, dynamics, config, model, streams, torch.device("cpu"), **options)


def drawn(generator):
    """A transition of the pendulum that means nothing."""
    draw = lambda *shape: torch.randn(*shape, generator=generator)  # noqa: E731
    return Batch(draw(4), draw(1).clamp(-1, 1), draw(1)[0], draw(4), torch.zeros(()))


@pytest.fixture
def agent(pendulum_spec):
    """Makes agents that remember 20 transitions."""

    def make(model=MODEL, **options):
        architecture = Architecture(4, 1, (16, 16), "relu")
        policy = ScratchPolicy.create(architecture, Streams(0).torch("policy"), init_std=1.0, normalize=True)
        made = make_agent(policy, pendulum_spec, replace(TINY, **options), model=model)
        generator = Streams(0).torch("transitions")
        for _ in range(20):
            made.buffer.add(drawn(generator))
        made.steps = 20
        return made

    return make


def updates(optimizer):
    return int(optimizer.state_dict()["steps"][0])


def test_targets_move_by_tau_and_actors_learn_every_second_update(agent):
    made = agent(updates_per_step=5, actor_every=2, tau=0.25)
    pairs = [(made.target_policy, made.policy), (made.target_critic, made.critic)]
    before = [[parameter.detach().clone() for parameter in target.parameters()] for target, _ in pairs]
    made.learn()
    compared = 0
    for olds, (target, online) in zip(before, pairs, strict=True):
        for old, moved, new in zip(olds, target.parameters(), online.parameters(), strict=True):
            torch.testing.assert_close(moved, 0.75 * old + 0.25 * new)
            compared += not torch.equal(old, new)
    assert compared > 6
    for _ in range(3):
        made.steps += 1  # as if one had been observed
        made.learn()
    assert (updates(made.critic_optimizer), updates(made.actor_optimizer)) == (20, 10)


def test_nothing_is_learnt_before_there_is_a_batch(agent):
    made = agent(batch_size=21)
    made.learn()
    assert updates(made.critic_optimizer) == 0
    made.buffer.add(drawn(Streams(1).torch("transitions")))
    made.learn()
    assert updates(made.critic_optimizer) == 5


def test_learning_rates_fall_to_zero_in_the_second_half(agent):
    made = agent(schedule="linear", actor_learning_rate=0.1)
    for progress, rate in ((0.4, 0.1), (0.75, 0.05), (1.0, 0.0)):
        made.set_progress(progress, progress)
        assert made.actor_optimizer.param_groups[0]["lr"] == pytest.approx(rate)


def test_noise_falls_over_the_budget(agent):
    made = agent(exploration_noise=0.5, final_noise=0.1)
    for progress, noise in ((0.0, 0.5), (0.5, 0.3), (1.0, 0.1)):
        made.set_progress(progress, progress)
        assert made.noise == pytest.approx(noise)


def observe(agent, *, terminated=False):
    zeros, flags = np.zeros((1, 4), np.float32), (np.array([terminated]), np.array([False]))
    agent.observe(zeros, np.zeros((1, 1), np.float32), Step(zeros, np.zeros(1, np.float32), *flags, zeros))


def test_random_steps_last_to_the_end_of_an_episode_but_not_for_ever(agent):
    """20 transitions are remembered; without noise the policy's own action is told from a random one."""
    observation = np.zeros((1, 4), np.float32)
    own = lambda made: np.array_equal(made.explore(observation), made.policy.act(observation).clip(-1, 1))  # noqa: E731
    options = {"exploration_noise": 0.0, "final_noise": 0.0}
    ended, endless = agent(random_steps=22, **options), agent(random_steps=3, **options)
    for terminated, acts in ((True, False), (False, False), (True, True)):  # at 21, 22 and 23 transitions
        observe(ended, terminated=terminated)
        assert own(ended) == acts
    for added in range(21, 31):
        observe(endless)
        assert own(endless) == (added == 30)


def test_actors_learn_every_second_update_however_long_an_action_is_held(agent):
    made = agent(updates_per_step=1, actor_every=2)
    for _ in range(8):
        made.steps += 4  # as if an action had been held for four steps
        made.learn()
    assert (updates(made.critic_optimizer), updates(made.actor_optimizer)) == (8, 4)


def test_a_core_that_acts_more_often_has_as_many_updates_in_a_second():
    every = DynaConfig(updates_per_step=10, hold_seconds=0.03)
    even = replace(every, even_updates=True)
    assert (every.updates(1, 0.008), even.updates(1, 0.008), even.updates(4, 0.008)) == (10, 3, 10)  # 2.5 an action
    assert (even.updates(1, 0.0), even.updates(2, 0.01)) == (10, 7)


def test_a_core_acts_from_the_first_step_and_is_held_to_what_it_did(full_core, pendulum_spec):
    observation, generator = torch.randn(8, 4, generator=Streams(0).torch("x")), Streams(0).torch("transitions")
    moved = {}
    for anchor in (0.0, 100.0):
        policy = wrap(full_core, pendulum_spec)
        config = replace(TINY, random_steps=100, anchor=anchor, exploration_noise=0.0)
        made, first = make_agent(policy, pendulum_spec, config), policy(observation)[0].detach()
        np.testing.assert_allclose(made.explore(observation[:1].numpy()), first[:1].clamp(-1, 1), atol=1e-6)
        for _ in range(30):
            made.buffer.add(drawn(generator))
            made.learn()
        moved[anchor] = float((policy(observation)[0] - first).detach().abs().mean())
    assert moved[100.0] < 0.5 * moved[0.0]


def test_a_policy_that_is_behind_its_core_is_held_as_firmly_at_the_end(full_core, pendulum_spec):
    observation = torch.randn(8, 4, generator=Streams(0).torch("x"))

    def moved(*, holds, behind):
        policy, generator = wrap(full_core, pendulum_spec), Streams(0).torch("transitions")
        made = make_agent(policy, pendulum_spec, replace(TINY, random_steps=100, anchor=100.0, anchor_holds=holds))
        first = policy(observation)[0].detach()
        made.set_progress(1.0, 0.0, behind=behind)
        for _ in range(30):
            made.buffer.add(drawn(generator))
            made.learn()
        return float((policy(observation)[0] - first).detach().abs().mean())

    free = moved(holds=False, behind=True)
    assert moved(holds=True, behind=False) == free
    assert moved(holds=True, behind=True) < 0.5 * free


def test_an_anchor_halves_while_the_policy_keeps_up_and_is_taken_up_again(full_core, pendulum_spec):
    def make():
        return make_agent(wrap(full_core, pendulum_spec), pendulum_spec, replace(TINY, anchor=0.8, anchor_halves=0.1))

    made, anchors = make(), []
    for progress, behind in ((0.1, True), (0.2, False), (0.4, False), (0.5, True), (0.9, True)):
        made.set_progress(progress, 0.0, behind=behind)
        anchors.append(made.anchor.weight)
    np.testing.assert_allclose(anchors, [0.8, 0.4, 0.1, 0.2, 0.8], rtol=1e-12)
    made.set_progress(0.95, 0.0, behind=False)
    again = make()
    again.restore(made.state())
    for one in (made, again):
        one.set_progress(1.0, 0.0, behind=False)
        assert one.anchor.weight == pytest.approx(0.4)
    again.set_progress(0.5, 0.0, behind=True)  # of a budget that has grown
    assert again.anchor.weight == pytest.approx(0.4)
    made.set_progress(9.0, 0.0, behind=False)
    assert made.anchor.weight == pytest.approx(0.8 / 1024)  # no more than ten times
    again.set_progress(0.75, 0.0)  # nothing is known of it
    assert again.anchor.weight == pytest.approx(0.2)


def test_a_wrapped_core_stays_while_it_is_frozen(full_core, pendulum_spec):
    policy = wrap(full_core, pendulum_spec, freeze={"core": 0.5})
    made = make_agent(policy, pendulum_spec, TINY, model=replace(MODEL, members=3), wrapped=True)
    core, generator = made.critic.ensemble.core.body[0].weight, Streams(0).torch("transitions")
    for _ in range(20):
        made.buffer.add(drawn(generator))
    for progress, learns in ((0.4, False), (0.6, True)):
        before = [core.detach().clone(), policy.core.body[0].weight.detach().clone()]
        made.set_progress(progress, progress)
        made.learn()  # actor and critics
        assert core.requires_grad == learns
        after = core, policy.core.body[0].weight
        assert [not torch.equal(old, new) for old, new in zip(before, after, strict=True)] == [learns, learns]


def test_every_part_frozen_is_no_error(full_core, pendulum_spec):
    policy = wrap(full_core, pendulum_spec)
    policy = wrap(full_core, pendulum_spec, freeze=dict.fromkeys(policy.parts(), 1.0))
    made, generator = make_agent(policy, pendulum_spec, replace(TINY, anchor=0.0)), Streams(0).torch("transitions")
    for _ in range(20):
        made.buffer.add(drawn(generator))
    made.learn()
    assert "actor" in made.losses


def test_without_imagining_the_model_is_fitted_until_rewards_or_ends_are_met(agent):
    assert not agent(curious_until=2).needs_model  # rewards differ
    for reward, terminated, needs in ((0, 0, True), (1, 0, False), (0, 1, False)):
        made = agent(curious_until=2)
        seen = made.buffer.all()
        seen.reward.fill_(0.0)
        seen.reward[0] = 1.0  # an episode that starts in the reward is not yet a way to it
        assert made.needs_model
        seen.reward[1:3], seen.terminated[3] = reward, terminated
        assert made.needs_model == needs
        seen.reward.fill_(0.0)
        assert made.needs_model == needs  # what was met once is known
    for setting in ({"model_share": 0.5}, {"keep_model": True}):
        assert agent(**setting).needs_model, setting


def test_novelty_is_the_reward_where_none_was_met(agent):
    for curious_until, fitted in ((2, True), (0, False)):
        made = agent(model=replace(MODEL, every=1), gamma=0.0, curious_until=curious_until)  # values are rewards
        made.buffer.all().reward.fill_(0.0)
        made.learn()
        assert made.fitted == fitted
        assert (made.losses["value"] > 0.0) == fitted


def test_the_largest_return_is_that_of_the_largest_reward_for_ever(agent):
    made = agent(gamma=0.9, reward_scale=0.1)
    made.buffer.all().reward.fill_(0.0)
    assert made.largest_return == pytest.approx(0.1 * 1 / 0.1)  # at least that of novelty
    made.buffer.all().reward[3] = -7.0
    assert made.largest_return == pytest.approx(0.1 * 7 / 0.1)


def test_before_an_action_is_over_nothing_has_been_met(agent):
    made = agent(gamma=0.9)
    made.buffer.added = 0
    assert made.unrewarded
    assert made.largest_return == pytest.approx(made.reward_scale / 0.1)


def test_an_agent_goes_on_from_its_state(agent):
    one, two = agent(), agent()
    one.learn()
    two.restore(one.state())
    for made in (one, two):
        observe(made)
        made.learn()
    assert torch.equal(one.critic(torch.ones(2, 4), torch.ones(2, 1)), two.critic(torch.ones(2, 4), torch.ones(2, 1)))
    assert np.array_equal(one.explore(np.ones((1, 4), np.float32)), two.explore(np.ones((1, 4), np.float32)))


def test_an_agent_that_has_met_a_reward_remembers_it_when_its_buffer_does_not(agent):
    one = agent(buffer_size=20)
    one.buffer.add(drawn(Streams(1).torch("ending"))._replace(terminated=torch.ones(())))
    assert not one.unrewarded
    for _ in range(20):
        one.buffer.add(Batch(torch.zeros(4), torch.zeros(1), torch.zeros(()), torch.zeros(4), torch.zeros(())))
    other = agent(buffer_size=20)
    other.restore(one.state())
    assert (one.unrewarded, other.unrewarded) == (False, False)


@pytest.mark.parametrize(("hold", "steps"), [(1, 40), (4, 160)])
def test_the_policy_that_is_kept_is_the_average_of_the_last_share_of_steps(agent, hold, steps):
    """At 40 actions and a share of a tenth, a quarter of what is new."""
    made = agent(average_share=0.1)
    old = [parameter.detach().clone() for parameter in made.average.parameters()]
    made.steps, made.hold = steps, hold
    made.learn()
    assert made.average is not made.policy
    assert made.average.normalizer is made.policy.normalizer
    compared = 0
    for before, average, new in zip(old, made.average.parameters(), made.policy.parameters(), strict=True):
        torch.testing.assert_close(average, 0.75 * before + 0.25 * new)
        compared += not torch.equal(before, average)
    assert compared >= 4


def test_units_of_the_critics_keep_a_norm_of_one(agent):
    made = agent(unit_norm=True, critics=3)
    made.learn()
    for layer in made.critic.ensemble.body:
        torch.testing.assert_close(layer.weight.norm(dim=1), torch.ones(3, layer.weight.shape[2]))
    assert not torch.equal(made.critic.ensemble.scales[0], torch.ones_like(made.critic.ensemble.scales[0]))


def test_rewards_can_be_divided_by_the_deviation_of_returns(agent):
    made = agent(normalize_reward=True, reward_scale=1.0)
    for reward in (1.0, 5.0):
        made.returns.add(np.array([reward]), np.array([True]))
    assert made.reward_scale == pytest.approx(0.5, rel=1e-2)
    assert agent(reward_scale=0.3).reward_scale == 0.3
