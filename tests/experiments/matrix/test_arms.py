from dataclasses import replace

import pytest
import torch

from experiments.matrix.arms import ARMS, PROBE_STEPS, WITHOUT_CORE, count_parameters
from transferkit.config import TrainConfig
from transferkit.policy.blueprints import build
from transferkit.policy.health import play
from transferkit.streams import Streams

CONFIG = TrainConfig("InvertedDoublePendulum-v5", core="made-up", seed=3)


def test_controls_differ_from_the_transfer_in_their_core_alone(untrained_core):
    policies = {name: arm(CONFIG, untrained_core)[1] for name, arm in ARMS.items()}
    reference = policies["transfer"].state_dict()
    for name in ("random", "shuffled", "frozen-random"):
        own = policies[name].state_dict()
        changed = {key for key in own if not torch.equal(own[key], reference[key])}
        assert any(key.startswith("core.body") for key in changed), name
        assert not any(key.startswith(("input_", "output_finetune", "normalizer")) for key in changed), name
    for name in ("frozen", "frozen-random"):
        frozen = {group.name for group in policies[name].parameter_groups() if group.frozen_share == 1}
        assert frozen == {"core"}


def test_the_matched_random_core_acts_as_strongly(untrained_core):
    observation = torch.from_numpy(play(CONFIG.env, PROBE_STEPS, CONFIG.seed))

    def strength(policy):
        return policy(observation)[0].square().mean().sqrt().item()

    reference, matched = (ARMS[name](CONFIG, untrained_core)[1] for name in ("transfer", "random-matched"))
    assert strength(matched) == pytest.approx(strength(reference), rel=1e-4)
    torch.testing.assert_close(matched(observation)[1], reference(observation)[1])


def test_the_matched_network_has_as_many_parameters(untrained_core):
    wanted = count_parameters(ARMS["transfer"](CONFIG, untrained_core)[1])
    config, policy = ARMS["scratch-matched"](CONFIG, untrained_core)
    wider = replace(config, network=replace(config.network, hidden=tuple(width + 1 for width in config.network.hidden)))
    assert count_parameters(policy) <= wanted < count_parameters(WITHOUT_CORE["scratch"](wider)[1])


def test_a_constant_policy_sees_nothing():
    policy = WITHOUT_CORE["constant"](CONFIG)[1]
    mean, log_std = policy(torch.randn(5, 9, generator=Streams(0).torch("x")))
    assert mean.shape == log_std.shape == (5, 1)
    assert mean.unique().numel() == 1
    again = build(policy.blueprint())
    again.load_state_dict(policy.state_dict())
    torch.testing.assert_close(again(torch.zeros(1, 9)), policy(torch.zeros(1, 9)))


def test_padding_gives_the_core_the_first_observations(untrained_core):
    config, policy = ARMS["padded"](CONFIG, untrained_core)
    observation = torch.arange(9.0)[None] / 10
    core = untrained_core.network(0)
    expected = core(untrained_core.normalizer(0)(observation[:, :4]))[0]
    torch.testing.assert_close(policy(observation)[0], expected)
    again = build(policy.blueprint())
    again.load_state_dict(policy.state_dict())
    torch.testing.assert_close(again(observation), policy(observation))
    assert config.wrap.freeze == {"input_adapter": 1.0, "output_adapter": 1.0}


@pytest.mark.parametrize("arm", ["random", "random-matched", "shuffled"])
def test_a_control_is_trained_however_bad_it_is(arm, untrained_core):
    assert CONFIG.wrap.probation
    assert not ARMS[arm](CONFIG, untrained_core)[0].wrap.probation
    assert ARMS["transfer"](CONFIG, untrained_core)[0] == CONFIG
