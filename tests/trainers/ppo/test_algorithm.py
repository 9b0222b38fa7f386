import copy
from itertools import chain

import numpy as np
import pytest
import rsl_rl.algorithms
import torch
from torch import nn
from torch.nn.utils import parameters_to_vector

from tests.trainers.ppo.steps import algorithm, play, step
from transferkit.trainers.ppo.minibatch import OneMinibatch


def value(ppo, observation):
    with torch.no_grad():
        return ppo.values.value(torch.tensor([observation])).item()


def targets(ppo, steps):
    """What the critic is trained towards after these steps."""
    ppo.learn(play(ppo, steps))
    return ppo.rollouts.returns[: len(steps)].flatten().tolist()


def test_gae_by_hand():
    """Two steps that end by termination: A1 = r1 - V1, A0 = r0 + g V1 - V0 + g lam A1."""
    ppo = algorithm(gamma=0.9, lam=0.5)
    v0, v1 = value(ppo, (0.0, 0.0)), value(ppo, (1.0, 0.0))
    a1 = 2.0 - v1
    a0 = 1.0 + 0.9 * v1 - v0 + 0.9 * 0.5 * a1
    found = targets(ppo, [step(1.0, following=(1.0, 0.0)), step(2.0, terminated=True)])
    assert found == pytest.approx([a0 + v0, a1 + v1], abs=1e-6)


@pytest.mark.parametrize("normalized", ["rollout", "batch"])
@pytest.mark.parametrize(("steps", "batch"), [(1, 64), (3, 2)])
def test_one_sample_alone_spoils_nothing(normalized, steps, batch):
    ppo = algorithm(normalize_advantage=normalized, rollout="steps", batch_size=batch)
    losses = ppo.learn(play(ppo, [step(1.0)] * steps))
    assert np.isfinite([*losses.values()]).all()
    assert torch.isfinite(parameters_to_vector(ppo.policy.parameters())).all()


def test_a_time_out_is_bootstrapped_with_the_true_final_observation():
    ppo = algorithm(gamma=0.9)
    expected = 1.0 + 0.9 * value(ppo, (5.0, 5.0))
    cut = step(1.0, truncated=True, final=(5.0, 5.0), following=(9.0, 9.0))
    assert targets(ppo, [cut]) == pytest.approx([expected], abs=1e-6)
    assert targets(algorithm(gamma=0.9, bootstrap_timeouts=False), [cut]) == pytest.approx([1.0])


def test_monte_carlo_targets_by_hand():
    ppo = algorithm(gamma=0.5, value_target="monte-carlo")
    found = targets(ppo, [step(1.0), step(2.0), step(4.0, terminated=True)])
    assert found == [1 + 0.5 * (2 + 0.5 * 4), 2 + 0.5 * 4, 4]


def test_rewards_are_divided_by_the_deviation_of_the_discounted_return():
    ppo = algorithm(gamma=0.5, normalize_reward=True)
    play(ppo, [step(1.0), step(2.0, terminated=True), step(3.0)])
    assert ppo.state()["running_return"] == [3.0]  # restarted after the termination
    returns = [1.0, 2.5, 3.0]
    assert ppo.rollouts.rewards[2].item() == pytest.approx(3.0 / np.sqrt(np.var(returns)), rel=1e-2)


def test_minibatches_cover_every_sample_once_an_epoch():
    def minibatches(epochs, **options):
        ppo = algorithm(rollout="steps", batch_size=3, **options)
        play(ppo, [step(float(k)) for k in range(4)])
        ppo.rollouts.close()
        return ppo.rollouts.actions, list(ppo.rollouts.minibatches(epochs))

    actions, batches = minibatches(2)
    assert [batch.actions.shape[0] for batch in batches] == [3, 1, 3, 1]
    first = torch.cat([batch.actions for batch in batches[:2]]).flatten()
    assert torch.equal(first.sort().values, actions.flatten().sort().values)
    assert not torch.equal(first, actions.flatten())
    actions, batches = minibatches(1, shuffle=False)
    assert torch.equal(torch.cat([batch.actions for batch in batches]), actions.flatten(0, 1))


def test_a_critic_of_its_own_rate_is_not_slowed_down_with_the_policy():
    """The first step of Adam is its learning rate, whatever the gradient."""
    ppo = algorithm(learning_rate=1e-5, schedule="fixed", critic_learning_rate=1e-2, epochs=1, max_grad_norm=None)
    last = play(ppo, [step(float(k), following=(k / 3, -k / 2)) for k in range(4)])
    weights = lambda: [parameters_to_vector(m.parameters()).detach() for m in (ppo.policy, ppo.values.body)]  # noqa: E731
    before = weights()
    ppo.learn(last)
    moved = [(new - old).abs().max().item() for new, old in zip(weights(), before, strict=True)]
    assert moved == pytest.approx([1e-5, 1e-2], rel=1e-2)


@pytest.mark.parametrize(("has_core", "moves"), [(True, [False, True]), (False, [True, True])])
def test_a_policy_with_a_core_waits_for_its_critic(has_core, moves):
    ppo = algorithm(schedule="adaptive", critic_first=0.1)
    ppo.policy.has_core = has_core
    moved = []
    for progress in (0.09, 0.1):
        ppo.set_progress(progress, 0)
        actor, critic = (parameters_to_vector(m.parameters()).detach().clone() for m in (ppo.policy, ppo.values.body))
        rate = ppo.learning_rate
        ppo.learn(play(ppo, [step(float(k), following=(k / 3, -k / 2)) for k in range(4)]))
        moved.append(not torch.equal(parameters_to_vector(ppo.policy.parameters()), actor))
        assert not torch.equal(parameters_to_vector(ppo.values.body.parameters()), critic)
        assert moved[-1] or ppo.learning_rate == rate
        learnt = ppo.learners[0].optimizer.state_dict()  # which moves the policy once its turn comes
        assert moved[-1] or not any(tensor.any() for tensor in (*chain(*learnt["moments"]), *learnt["steps"]))
    assert moved == moves


@pytest.mark.parametrize(
    ("schedule", "progress", "episodes", "rate"),
    [("fixed", 0.5, 250, 1e-3), ("linear", 0.25, 250, 7.5e-4), ("step", 0.25, 250, 8.1e-4), ("step", 0.25, 99, 1e-3)],
)
def test_learning_rates_follow_their_schedule(schedule, progress, episodes, rate):
    ppo = algorithm(schedule=schedule, learning_rate=1e-3)
    ppo.set_progress(progress, episodes)
    assert ppo.learning_rate == pytest.approx(rate)
    assert {group["lr"] for group in ppo.optimizer.param_groups} == {ppo.learning_rate}


def test_between_two_rollouts_it_goes_on_from_its_state():
    rollouts = [[step(float(k + n), following=(k / 3, -k / 2)) for k in range(4)] for n in range(3)]
    one, two = algorithm(normalize_reward=True), algorithm(normalize_reward=True)
    for rollout in rollouts[:2]:
        one.learn(play(one, rollout))
    two.restore(copy.deepcopy(one.state()))
    losses = [ppo.learn(play(ppo, rollouts[2])) for ppo in (one, two)]
    assert losses[0] == losses[1]
    for a, b in zip(one.policy.parameters(), two.policy.parameters(), strict=True):
        assert torch.equal(a, b)


def test_compiled_updates_differ_by_rounding_and_take_minibatches_of_any_size():
    """The second rollout has other sizes, for which nothing is compiled anew."""
    options = {"rollout": "adaptive", "batch_size": 2, "epochs": 2, "schedule": "adaptive", "entropy_coefficient": 0.01}
    eager, fast = algorithm(**options), algorithm(**options, compiles=True)
    for n, recompiles in ((6, True), (9, False)):
        steps = [step(float(k), following=(k / 3, -k / 2)) for k in range(n)]
        with torch._dynamo.config.patch(error_on_recompile=not recompiles):
            losses = [ppo.learn(play(ppo, steps)) for ppo in (eager, fast)]
        assert losses[1] == pytest.approx(losses[0], rel=1e-4)
    assert fast.learning_rate == pytest.approx(eager.learning_rate)
    for a, b in zip(eager.policy.parameters(), fast.policy.parameters(), strict=True):
        torch.testing.assert_close(a, b, rtol=1e-4, atol=1e-6)


class Stock(nn.Module):
    """A network of ours as rsl_rl would have it: its own parameters, and torch's distribution."""

    is_recurrent = False

    def __init__(self, network):
        super().__init__()
        self.network = copy.deepcopy(network)
        for name, parameter in list(self.network.named_parameters()):  # no longer views of flat tensors
            owner, _, attribute = name.rpartition(".")
            setattr(self.network.get_submodule(owner), attribute, nn.Parameter(parameter.detach().clone()))

    def parameters(self, recurse=True):
        return iter([parameter for _, parameter in self.network.named_parameters()])

    def forward(self, obs, **_):
        found = self.network(obs.tensor)
        if isinstance(found, tuple):
            self.output_distribution_params = found
            self.distribution = torch.distributions.Normal(found[0], found[1].exp())
        return found

    def get_output_log_prob(self, actions):
        return self.distribution.log_prob(actions).sum(-1)

    @property
    def output_entropy(self):
        return self.distribution.entropy().sum(-1)

    def get_kl_divergence(self, old, new):
        old, new = (torch.distributions.Normal(mean, log_std.exp()) for mean, log_std in (old, new))
        return torch.distributions.kl_divergence(old, new).sum(-1)

    def update_normalization(self, obs):
        """Nothing is normalised."""


@pytest.mark.parametrize("schedule", ["fixed", "adaptive"])
def test_our_update_equals_stock_rsl_rl_with_stock_adam(schedule):
    """Flat weights, the step and the handwritten density change the speed and nothing else."""
    options = {"batch_size": 2, "rollout": "steps", "epochs": 3, "shuffle": False, "entropy_coefficient": 0.01}
    ours = algorithm(**options, max_grad_norm=0.1, schedule=schedule, critic_learning_rate=None)
    last = play(ours, [step(float(k), following=(k / 3, -k / 2)) for k in range(4)])
    before, minibatches, update = ours.learning_rate, [], ours._update_minibatch

    def noted(rule, actor, critic, minibatch, *rest):
        minibatches.append(minibatch)
        return update(rule, actor, critic, minibatch, *rest)

    theirs = StockPPO(ours)
    ours._update_minibatch = noted
    losses = ours.learn(last)
    assert losses == pytest.approx(theirs.update(minibatches), rel=1e-5)
    assert ours.learning_rate == pytest.approx(theirs.learning_rate)
    assert (ours.learning_rate == pytest.approx(before)) == (schedule == "fixed")
    for own, stock in ((ours.policy, theirs.actor), (ours.values, theirs.critic)):
        other = dict(stock.network.named_parameters())
        for name, parameter in own.named_parameters():
            torch.testing.assert_close(parameter.detach(), other[name].detach(), rtol=1e-4, atol=1e-6)


class StockPPO:
    """What rsl_rl's update reads of its algorithm, with its own schedule, torch's clipping and torch's Adam."""

    rnd = symmetry = None
    use_mixed_precision = use_clipped_value_loss = is_multi_gpu = normalize_advantage_per_mini_batch = False
    num_mini_batches = num_learning_epochs = 1
    gpu_global_rank, device = 0, "cpu"

    def __init__(self, ours):
        self.actor, self.critic = Stock(ours.policy), Stock(ours.values)
        self.clip_param, self.value_loss_coef = ours.config.clip, ours.config.value_coefficient
        self.entropy_coef, self.max_grad_norm = ours.config.entropy_coefficient, ours.config.max_grad_norm
        self.schedule, self.desired_kl, self.learning_rate = ours.config.schedule, ours.config.desired_kl, ours.learning_rate
        parameters = [*self.actor.parameters(), *self.critic.parameters()]
        self.optimizer = torch.optim.Adam(parameters, lr=ours.learning_rate)

    def update(self, minibatches):
        losses = []
        for minibatch in minibatches:
            self.storage = OneMinibatch(minibatch)
            losses.append(rsl_rl.algorithms.PPO.update(self))
        return {name: np.mean([loss[name] for loss in losses]) for name in losses[0]}
