from dataclasses import replace

import numpy as np
import pytest
import torch

from transferkit.config import DynaConfig, PPOConfig, TrainConfig
from transferkit.dyna import Batch, ImaginedEnv, ReplayBuffer, fit
from transferkit.dyna.agent import Agent
from transferkit.dyna.imagine import imagine
from transferkit.dyna_ppo import Learner
from transferkit.errors import ConfigError
from transferkit.nn import Architecture, Dynamics, Ensemble, EnsembleArchitecture, JointInput
from transferkit.nn.optimizer import Part, PartAdam
from transferkit.policy import ScratchPolicy, wrap
from transferkit.policy.parts import learning_parts, make_critic, make_dynamics
from transferkit.run.streams import Streams
from transferkit.transfer import run_training

IDP = "InvertedDoublePendulum-v5"
TINY = DynaConfig(hidden=(16, 16), model_hidden=(16,), batch_size=8, random_steps=0, model_share=0.0)


def fill(buffer, n=200):
    """Transitions of x' = x + a, reward a, an end beyond 2."""
    generator = Streams(0).torch("transitions")
    for _ in range(n):
        observation, action = torch.randn(1, generator=generator), torch.rand(1, generator=generator) * 2 - 1
        following = observation + action
        buffer.add(Batch(observation, action, action[0], following, (following[0] > 2).float()))


def make_agent(policy, spec, config):
    streams = Streams(0)
    critic = make_critic(policy, config, streams.torch("critic"))
    model = make_dynamics(policy, spec, config, streams.torch("model"))
    return Agent(policy, critic, model, config, streams, torch.device("cpu"))


@pytest.fixture
def agent(pendulum_spec):
    def make(**options):
        architecture = Architecture(4, 1, (16, 16), "relu")
        policy = ScratchPolicy.create(architecture, Streams(0).torch("policy"), init_std=1.0, normalize=True)
        made = make_agent(policy, pendulum_spec, replace(TINY, **options))
        made.set_progress(0.0, 0.0)
        generator = Streams(0).torch("transitions")
        for _ in range(20):
            draw = lambda *shape: torch.randn(*shape, generator=generator)  # noqa: E731
            made.buffer.add(Batch(draw(4), draw(1).clamp(-1, 1), draw(1)[0], draw(4), torch.zeros(())))
        return made

    return make


def test_targets_move_by_tau_and_actors_learn_every_second_update(agent, monkeypatch):
    made, actor_updates = agent(updates_per_step=5, actor_every=2, tau=0.25), []
    update = made._update_actor
    monkeypatch.setattr(made, "_update_actor", lambda observation: (actor_updates.append(1), update(observation)))
    before = [target.clone() for target in made._targets]
    made.learn()
    for old, target, online in zip(before, made._targets, made._online, strict=True):
        assert not torch.equal(old, online)
        torch.testing.assert_close(target, 0.75 * old + 0.25 * online)
    for _ in range(3):
        made.buffer.added += 1  # as if a step had been added
        made.learn()
    assert len(actor_updates) == 10


def test_learning_rates_fall_to_zero_in_the_second_half(agent):
    made = agent(schedule="linear", actor_learning_rate=0.1)
    for progress, rate in ((0.4, 0.1), (0.75, 0.05), (1.0, 0.0)):
        made.set_progress(progress, progress)
        assert made.actor_optimizer.param_groups[0]["lr"] == pytest.approx(rate)


def test_the_model_learns_and_the_imagined_env_follows_it():
    buffer, config = ReplayBuffer(1, 1, 1000), DynaConfig(model_updates=600, model_hidden=(32,), model_members=3)
    fill(buffer, 1000)
    ensemble = Ensemble(EnsembleArchitecture(3, 2, Dynamics.out_dim(1), (32,)), Streams(0).torch("model"))
    model = Dynamics(JointInput(None), ensemble, 1)
    optimizer = PartAdam([Part(list(model.parameters()))], 3e-3)
    fit(model, optimizer, buffer, config, Streams(0).torch("fit"))
    test, action = torch.linspace(-1.5, 1.5, 20).unsqueeze(1), torch.full((20, 1), 0.4)
    prediction = model.predict(test, action)
    assert (prediction.next_observation.mean(0) - test - 0.4).abs().max() < 0.15
    assert (prediction.reward.mean(0) - 0.4).abs().max() < 0.15
    assert model.predict(torch.tensor([[1.9]]), torch.tensor([[0.9]])).terminated.mean() > 0.5
    assert model.predict(torch.tensor([[-1.0]]), torch.tensor([[0.0]])).terminated.mean() < 0.5
    world = ImaginedEnv(model, buffer, 6, members=3, horizon=3, generator=Streams(0).torch("world"))
    start = world.reset()
    steps = [world.step(torch.full((6, 1), -0.5).numpy()) for _ in range(3)]
    assert abs(steps[0].final_observation - (start - 0.5)).max() < 0.2
    assert [step.truncated.any() for step in steps] == [False, False, True]
    assert (steps[2].observation != steps[2].final_observation).all()  # all began anew


def test_imagined_rows_on_which_members_disagree_are_dropped():
    class Split(torch.nn.Module):
        """Two members that differ on positive observations only."""

        def forward(self, x):
            change = torch.stack((x[..., :1] * 0, x[..., :1].clamp(min=0)))
            return torch.cat((change, torch.zeros(2, x.shape[-2], 4)), -1)

    buffer, config = ReplayBuffer(1, 1, 100), DynaConfig(keep_share=0.4, planned_action="replayed", model_members=2)
    for value in (-1.0, 1.0):
        buffer.add(Batch(torch.tensor([value]), torch.zeros(1), torch.zeros(()), torch.zeros(1), torch.zeros(())))
    rows = imagine(40, torch.nn.Identity(), Dynamics(JointInput(None), Split(), 1), buffer, config, Streams(0).torch("x"))
    assert len(rows) == 40
    assert (buffer.split(rows).observation == -1).all()


def test_a_core_acts_from_the_first_step_and_is_held_to_what_it_did(core_with_parts, pendulum_spec):
    observation, generator = torch.randn(8, 4, generator=Streams(0).torch("x")), Streams(0).torch("transitions")
    moved = {}
    for anchor in (0.0, 100.0):
        policy = wrap(core_with_parts, pendulum_spec)
        config = replace(TINY, model_members=3, random_steps=100, anchor=anchor, exploration_noise=0.0)
        made, first = make_agent(policy, pendulum_spec, config), policy(observation)[0].detach()
        np.testing.assert_allclose(made.explore(observation[:1].numpy()), first[:1].clamp(-1, 1), atol=1e-6)
        for _ in range(80):
            draw = lambda *shape: torch.randn(*shape, generator=generator)  # noqa: E731
            made.buffer.add(Batch(draw(4), draw(1).clamp(-1, 1), draw(1)[0], draw(4), torch.zeros(())))
            made.learn()
        moved[anchor] = float((policy(observation)[0] - first).detach().abs().mean())
    assert moved[100.0] < 0.5 * moved[0.0]


def test_a_wrapped_core_learns_slower_and_stays_while_it_is_frozen(core_with_parts, pendulum_spec):
    policy = wrap(core_with_parts, pendulum_spec, lr_scale={"core": 0.2}, freeze={"core": 0.5})
    made = make_agent(policy, pendulum_spec, replace(TINY, critics=2, model_members=3, wrap_critic=True))
    scales = [part.lr_scale for part in learning_parts(made.critic, policy)]
    assert scales == [1.0, 0.2]
    weight = made.critic.ensemble.core.body[0].weight
    made.set_progress(0.4, 0.4)
    assert not weight.requires_grad
    made._update_actor(torch.zeros(2, 4))
    assert not weight.requires_grad
    made.set_progress(0.6, 0.6)
    assert weight.requires_grad


def test_every_part_frozen_is_no_error(core_with_parts, pendulum_spec):
    parts = wrap(core_with_parts, pendulum_spec).parts()
    policy = wrap(core_with_parts, pendulum_spec, freeze=dict.fromkeys(parts, 1.0))
    made = make_agent(policy, pendulum_spec, replace(TINY, critics=2, model_members=3))
    made.set_progress(0.0, 0.0)
    made._update_actor(torch.zeros(2, 4))


def test_controls_share_no_trained_weights(core_with_parts):
    for control in (core_with_parts.randomized(0), core_with_parts.shuffled(0)):
        for part in ("policy", "critic", "dynamics"):
            for name, tensor in control.parts[part].items():
                varies = core_with_parts.parts[part][name].std() > 0
                assert not varies or not torch.equal(tensor, core_with_parts.parts[part][name]), (part, name)


def test_the_discount_follows_the_time_step():
    assert DynaConfig(discount_seconds=2.0).for_time_step(0.02).gamma == pytest.approx(0.99005, abs=1e-5)
    assert DynaConfig(discount_seconds=None, gamma=0.9).for_time_step(0.02).gamma == 0.9
    assert DynaConfig(gamma=0.9).for_time_step(0.0).gamma == 0.9


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
        made = agent(curious_until=curious_until, model_every=1, gamma=0.0)  # values are rewards
        made.buffer.all().reward.fill_(0.0)
        made.learn()
        assert made.fitted == fitted
        assert (made.losses["value"] > 0.0) == fitted


def test_noise_falls_over_the_budget(agent):
    made = agent(exploration_noise=0.5, final_noise=0.1)
    for progress, noise in ((0.0, 0.5), (0.5, 0.3), (1.0, 0.1)):
        made.set_progress(progress, progress)
        assert made.noise == pytest.approx(noise)


def test_no_reward_yet_is_no_divergence(tmp_path):
    config = TrainConfig("dm_control/pendulum-swingup-v0", algo="dyna-ddpg", steps=300, eval_episodes=1, dyna=TINY)
    assert run_training(config, out=tmp_path / "run").steps == 300


@pytest.mark.parametrize(
    ("options", "message"),
    [
        ({"gamma": 1.0}, "gamma=1.0"),
        ({"model_share": 1.5}, "model_share=1.5"),
        ({"discount_seconds": 0.0}, "discount_seconds=0.0"),
        ({"ppo_horizon": 0}, "ppo_horizon=0"),
        ({"model_loss": "squared-error"}, "neither rewards nor terminations"),
    ],
)
def test_impossible_settings_are_refused(options, message):
    with pytest.raises(ConfigError, match=message):
        DynaConfig(**options)


@pytest.mark.parametrize(("schedule", "rate"), [("adaptive", 1.5e-4), ("fixed", 3e-4)])
def test_dyna_ppo_has_no_steps_by_kl_divergence(pendulum_spec, schedule, rate):
    streams = Streams(0)
    policy = ScratchPolicy.create(Architecture(4, 1, (8,)), streams.torch("policy"), init_std=0.5, normalize=False)
    model = make_dynamics(policy, pendulum_spec, TINY, streams.torch("model"))
    learner = Learner(policy, model, (PPOConfig(schedule=schedule), TINY), streams, torch.device("cpu"))
    learner.algorithm.set_learning_rate(0.5, 0)
    assert learner.algorithm.learning_rate == pytest.approx(rate)
    assert learner.algorithm.optimizer.parts[-1].lr is None


def test_a_budget_too_small_for_dyna_ppo_is_refused(tmp_path):
    with pytest.raises(ConfigError, match="before dyna-ppo learnt anything"):
        run_training(TrainConfig(IDP, algo="dyna-ppo", steps=100), out=tmp_path / "run")
