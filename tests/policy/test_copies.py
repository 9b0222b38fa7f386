"""One core that drives several limbs: Hopper's leg as both of the walker's."""

from dataclasses import replace

import numpy as np
import pytest
import torch

from transferkit import Budget, load_core, train, wrap
from transferkit.envs import derive_spec
from transferkit.nn import Architecture, Ensemble, EnsembleArchitecture, Normalizer, PolicyNet
from transferkit.policy.core import Core, stack_members
from transferkit.streams import Streams

HOPPER, WALKER = "Hopper-v5", "Walker2d-v5"
OPTIONS = {"limbs": "all", "forces": "load", "residual": 0}


@pytest.fixture(scope="module")
def leg():
    """An untrained core of Hopper with made-up statistics, whose actions are not small."""
    network = PolicyNet(Architecture(11, 3, (16,)), Streams(0).torch("core"))
    torch.nn.init.normal_(network.mean_head.weight, generator=Streams(1).torch("head"))
    normalizer = Normalizer(11)
    normalizer.update(torch.from_numpy(np.random.default_rng(0).normal(0.5, 2.0, (50, 11)).astype(np.float32)))
    parts = {"policy": stack_members([network.state_dict()]), "normalizer": stack_members([normalizer.state_dict()])}
    return Core("leg-v1", derive_spec(HOPPER), network.architecture, (0,), parts)


def walker(*, torso, right, left):
    """What the walker observes: height and torso, then the angles of each leg; the same of velocities, with x first."""
    half = [*torso[:2], *right[:3], *left[:3]]
    return np.array([[*half, torso[2], torso[3], torso[4], *right[3:], *left[3:]]], np.float32)


def test_every_leg_acts_as_the_core_would_on_it_alone(leg):
    torso, right, left = np.random.default_rng(1).normal(size=(3, 6))
    policy = wrap(leg, WALKER, **OPTIONS)
    action = policy.act(walker(torso=torso, right=right, left=left))[0]
    factor = 200 / 100 / 2 * sum(j.mass for j in policy.target.joints if j.parent is None)
    factor /= sum(j.mass for j in leg.spec.joints if j.parent is None)
    for k, own in ((0, right), (3, left)):
        alone = [*torso[:2], *own[:3], *torso[2:5], *own[3:]]
        expected = leg.policy().act(np.array([alone], np.float32))[0] * factor
        np.testing.assert_allclose(action[k : k + 3], expected, rtol=1e-4, atol=1e-5)


def test_copies_share_the_cores_weights_and_are_named_apart(leg):
    policy = wrap(leg, WALKER, **OPTIONS)
    assert sum(p.numel() for p in policy.core.parameters()) == sum(p.numel() for p in leg.network().parameters())
    names = policy.trace_names()
    assert [names["core_input"][k] for k in (0, 11)] == ["slide_z.position[1]", "slide_z.position[2]"]
    trace = policy.trace(torch.zeros(5, 17))
    assert {name: tensor.shape[1] for name, tensor in trace.items()} == {name: len(own) for name, own in names.items()}
    observation = torch.randn(4, 17, generator=Streams(2).torch("x"))
    torch.testing.assert_close(policy.head()(policy.features(observation)), policy(observation)[0])


@pytest.mark.parametrize("algo", ["ppo", "dyna-ddpg"])
def test_a_walker_that_was_trained_on_two_copies_is_a_core_itself(leg, tmp_path, algo):
    settings = {"ppo": {"ppo.rollout_steps": 32, "ppo.batch_size": 16}, "dyna-ddpg": {"dyna.updates_per_step": 1}}[algo]
    policy = wrap(leg, WALKER, **OPTIONS, hold=2)
    train(policy, WALKER, Budget(steps=200), algo=algo, settings=settings, eval_episodes=1, out=tmp_path / "run")
    core = load_core(tmp_path / "run")
    assert core.architecture.blueprint["match"]["copies"] == 2
    again, observation = wrap(core, WALKER, residual=0), np.random.default_rng(2).normal(size=(3, 17)).astype(np.float32)
    np.testing.assert_allclose(again.act(observation), policy.act(observation), rtol=1e-4, atol=1e-4)


def test_critics_of_one_leg_do_not_judge_two(leg, tmp_path):
    architecture = EnsembleArchitecture(2, 14, 1, (8,))
    state = {f"ensemble.{name}": tensor for name, tensor in Ensemble(architecture).state_dict().items()}
    core = replace(leg, components={**leg.components, "critic": stack_members([state])}, ensembles={"critic": architecture})
    settings = {"dyna.critics": 2, "dyna.drawn_critics": "none", "dyna.updates_per_step": 1}
    policy = wrap(core, WALKER, **OPTIONS, critic=True)
    result = train(policy, WALKER, Budget(steps=200), algo="dyna-ddpg", settings=settings, eval_episodes=1, out=tmp_path)
    assert result.steps == 200
