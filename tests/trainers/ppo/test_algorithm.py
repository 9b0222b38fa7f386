import copy

import numpy as np
import pytest
import rsl_rl.algorithms
import torch
from torch.nn.utils import parameters_to_vector

from transferkit.config import PPOConfig
from transferkit.envs import Step
from transferkit.nn import Architecture
from transferkit.policy import ScratchPolicy
from transferkit.ppo.algorithm import PPO
from transferkit.ppo.train import collect
from transferkit.run.streams import Streams

CPU = torch.device("cpu")


def algorithm(**options):
    config = PPOConfig(num_envs=1, rollout_steps=4, normalize_reward=False, normalize_observation=False, **options)
    policy = ScratchPolicy.create(Architecture(2, 1, (8,)), Streams(0).torch("policy"), init_std=0.5, normalize=False)
    return PPO(policy, config, Streams(0), CPU)


def step(reward, *, terminated=False, truncated=False, final=(0.0, 0.0), following=(0.0, 0.0)):
    array = lambda x: np.array([x], np.float32)  # noqa: E731
    return Step(array(following), array(reward), np.array([terminated]), np.array([truncated]), array(final))


def play(ppo, steps, observation=(0.0, 0.0)):
    with torch.no_grad():
        for s in steps:
            ppo.act(torch.tensor([observation]))
            ppo.process_step(s)
            observation = tuple(s.observation[0].tolist())
        ppo.compute_returns(torch.tensor([observation]))
    return ppo.storage


def value(ppo, observation):
    with torch.no_grad():
        return ppo.critic(torch.tensor([observation])).item()


def test_gae_by_hand():
    """Two steps that end by termination: A1 = r1 - V1, A0 = r0 + g V1 - V0 + g lam A1."""
    ppo = algorithm(gamma=0.9, lam=0.5)
    storage = play(ppo, [step(1.0, following=(1.0, 0.0)), step(2.0, terminated=True)])
    v0, v1 = value(ppo, (0.0, 0.0)), value(ppo, (1.0, 0.0))
    a1 = 2.0 - v1
    a0 = 1.0 + 0.9 * v1 - v0 + 0.9 * 0.5 * a1
    assert storage.returns.flatten().tolist() == pytest.approx([a0 + v0, a1 + v1], abs=1e-6)


def test_a_time_out_is_bootstrapped_with_the_true_final_observation():
    ppo = algorithm(gamma=0.9)
    storage = play(ppo, [step(1.0, truncated=True, final=(5.0, 5.0), following=(9.0, 9.0))])
    assert storage.returns.item() == pytest.approx(1.0 + 0.9 * value(ppo, (5.0, 5.0)), abs=1e-6)
    merged = algorithm(gamma=0.9, bootstrap_timeouts=False)
    assert play(merged, [step(1.0, truncated=True, final=(5.0, 5.0))]).returns.item() == pytest.approx(1.0)


def test_monte_carlo_targets_by_hand():
    ppo = algorithm(gamma=0.5, value_target="monte-carlo")
    storage = play(ppo, [step(1.0), step(2.0), step(4.0, terminated=True)])
    assert storage.returns.flatten().tolist() == [1 + 0.5 * (2 + 0.5 * 4), 2 + 0.5 * 4, 4]


def test_rewards_are_divided_by_the_deviation_of_the_discounted_return():
    ppo = algorithm(gamma=0.5)
    ppo.config = PPOConfig(num_envs=1, gamma=0.5, normalize_reward=True)
    scaled = [float(ppo._scale(step(r, terminated=end))[0]) for r, end in ((1.0, False), (2.0, True), (3.0, False))]
    assert float(ppo._running_return[0]) == 3.0  # restarted after the termination
    returns = [1.0, 2.5, 3.0]
    assert scaled[2] == pytest.approx(3.0 / np.sqrt(np.var(returns)), rel=1e-2)


def test_minibatches_cover_every_sample_once_an_epoch():
    ppo = algorithm(rollout="steps", batch_size=3, epochs=2)
    storage = play(ppo, [step(float(k)) for k in range(4)])
    batches = list(storage.mini_batch_generator(storage.num_mini_batches, 2))
    sizes = [batch.actions.shape[0] for batch in batches]
    assert sizes == [3, 1, 3, 1]
    first = torch.cat([batch.actions for batch in batches[:2]]).flatten().sort().values
    assert torch.equal(first, storage.actions.flatten().sort().values)
    sequential = play(algorithm(rollout="steps", shuffle=False, batch_size=3), [step(float(k)) for k in range(4)])
    assert torch.equal(next(iter(sequential.mini_batch_generator(2, 1))).actions, sequential.actions.flatten(0, 1)[:3])


class Scripted:
    """An environment that ends an episode at the steps it is told, counted from 1."""

    num_envs = 1

    def __init__(self, *ends):
        self.ends, self.steps = ends, 0

    def step(self, actions, count=None):
        self.steps += 1
        return step(1.0, terminated=self.steps in self.ends)


@pytest.mark.parametrize(
    ("rollout", "ends", "lengths"),
    [
        ("steps", (6,), [4, 4, 4]),
        ("episode", (1, 3), [1, 2, 4]),
        ("adaptive", (1, 3, 11), [4, 7, 2048]),  # at least 4; on to the end of an episode; not for ever
    ],
)
def test_a_rollout_is_as_long_as_its_kind_says(rollout, ends, lengths):
    ppo, env, found = algorithm(rollout=rollout), Scripted(*ends), []
    observation = np.zeros((1, 2), np.float32)
    for _ in lengths:
        collect(ppo, env, observation, ppo.config)
        found.append(ppo.storage.step)
        ppo.storage.clear()
    assert found == lengths


def test_a_rollout_waits_no_longer_than_a_twentieth_of_the_budget():
    config = PPOConfig(rollout_steps=128)
    assert [config.rollout_is_over(128, ended=False, share=share) for share in (0.04, 0.05)] == [False, True]
    assert not config.rollout_is_over(127, ended=True, share=1.0)


@pytest.mark.parametrize(
    ("rollout", "steps", "sizes"),
    [
        ("steps", 129, [64, 64, 1]),
        ("adaptive", 129, [65, 64]),  # none so small that its noise is a step
        ("adaptive", 50, [50]),
        ("adaptive", 1952, [244] * 8),
    ],
)
def test_an_adaptive_rollout_is_cut_evenly(rollout, steps, sizes):
    assert PPOConfig(rollout=rollout, batch_size=64).minibatch_sizes(steps) == sizes


def test_a_critic_of_its_own_rate_is_not_slowed_down_with_the_policy():
    """The first step of Adam is its learning rate, whatever the gradient."""
    ppo = algorithm(learning_rate=1e-5, schedule="fixed", critic_learning_rate=1e-2, epochs=1, max_grad_norm=None)
    play(ppo, [step(float(k), following=(k / 3, -k / 2)) for k in range(4)])
    weights = lambda: [parameters_to_vector(torch.nn.Module.parameters(m)).detach() for m in (ppo.actor, ppo.critic)]  # noqa: E731
    before = weights()
    ppo.update()
    moved = [(new - old).abs().max().item() for new, old in zip(weights(), before, strict=True)]
    assert moved == pytest.approx([1e-5, 1e-2], rel=1e-2)


@pytest.mark.parametrize("schedule", ["fixed", "adaptive"])
def test_our_update_equals_stock_rsl_rl_with_stock_adam(schedule):
    """Flat buffers, the fused step and the handwritten density gradient change the speed and nothing else."""
    options = {"batch_size": 2, "epochs": 3, "shuffle": False, "entropy_coefficient": 0.01, "max_grad_norm": 0.1}
    ours = algorithm(**options, schedule=schedule, critic_learning_rate=None)
    play(ours, [step(float(k), following=(k / 3, -k / 2)) for k in range(4)])
    stock = copy.deepcopy(ours)
    named = [(model, name, p) for model in ("actor", "critic") for name, p in getattr(stock, model).named_parameters()]
    for model, name, parameter in named:  # plain parameters, no longer views of flat buffers
        owner, _, attribute = name.rpartition(".")
        plain = torch.nn.Parameter(parameter.detach().clone())
        setattr(getattr(stock, model).get_submodule(owner), attribute, plain)
    stock.actor.clipped_by_optimizer = stock.critic.clipped_by_optimizer = False
    stock.max_grad_norm = ours.config.max_grad_norm
    stock.optimizer = torch.optim.Adam([*stock.actor.parameters(), *stock.critic.parameters()], lr=ours.learning_rate)
    stock.num_mini_batches = 2
    losses = ours.update(), rsl_rl.algorithms.PPO.update(stock)
    assert losses[0] == pytest.approx(losses[1], rel=1e-5)
    assert ours.learning_rate == stock.learning_rate
    assert (ours.learning_rate == ours.config.learning_rate) == (schedule == "fixed")
    for model in ("actor", "critic"):
        theirs = dict(getattr(stock, model).named_parameters())
        for name, parameter in getattr(ours, model).named_parameters():
            torch.testing.assert_close(parameter.detach(), theirs[name].detach(), rtol=1e-4, atol=1e-6)
