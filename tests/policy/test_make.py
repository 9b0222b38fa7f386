import copy
import math
from dataclasses import replace

import numpy as np
import pytest
import torch

from tests.policy.cores import random_core
from tests.toys import Counter
from transferkit import Budget, distill, evaluate, health, load_core, load_policy, load_subject, make_env, match, train, wrap
from transferkit.config import PRESETS, NetworkConfig, TrainConfig
from transferkit.envs import derive_spec
from transferkit.errors import (
    ConfigError,
    DimensionError,
    EnvironmentContractError,
    RunDirectoryError,
    SettingError,
    UnknownNameError,
)
from transferkit.matching import load_match, save_match
from transferkit.nn import PolicyNet
from transferkit.policy.blueprints import build
from transferkit.policy.core import Core, stack_members
from transferkit.policy.make import new_policy, scratch_policy
from transferkit.policy.paper import PaperSandwich
from transferkit.streams import Streams

IP, IDP, CARTPOLE = "InvertedPendulum-v5", "InvertedDoublePendulum-v5", "dm_control/cartpole-balance-v0"


@pytest.mark.parametrize("gravity", [1, 4])
def test_a_matched_policy_acts_as_the_core_would_in_the_similar_state(untrained_core, specs, gravity):
    """Lengths 0.3 m and 0.5 m to the pole's mass; Froude: x scales with 0.6, speed with sqrt(0.6), rate with 1/sqrt(0.6).

    Under four times the gravity all is twice as fast, and accelerations are four times as large.
    """
    policy = wrap(untrained_core, derive_spec(f"{CARTPOLE}?vary.gravity={gravity}"))
    x, angle, v, rate = 0.3, 2.5, -0.7, 1.1
    observation = torch.tensor([[x, np.cos(angle), np.sin(angle), v, rate]], dtype=torch.float32)
    slow = gravity**-0.5
    similar = torch.tensor([[0.6 * x, angle, 0.6**0.5 * slow * v, slow * rate / 0.6**0.5]], dtype=torch.float32)
    gain = gravity * specs["InvertedPendulum-v5"].action[0].authority / specs[CARTPOLE].action[0].authority
    with torch.no_grad():
        expected = gain * untrained_core.policy(0)(similar)[0]
        torch.testing.assert_close(policy(observation)[0], expected, rtol=1e-4, atol=1e-5)


@pytest.mark.parametrize("factor", [1.0, -1.0, 0.25])
def test_a_squashed_core_acts_as_its_match_says_whatever_the_factor(specs, factor):
    spec = specs["InvertedPendulum-v5"]
    network = PolicyNet(replace(random_core(spec).architecture, squash=True), Streams(0).torch("policy"), init_std=1.0)
    torch.nn.init.constant_(network.mean_head.bias, 2.0)
    core = Core("squashed-v1", spec, network.architecture, [0], {"policy": stack_members([network.state_dict()])})
    found = match(core, spec)
    (actions,) = (copy.actions for copy in found.copies)
    scaled = {name: {own: factor * share for own, share in shares.items()} for name, shares in actions.items()}
    policy = wrap(core, spec, match=replace(found, copies=(replace(found.copies[0], actions=scaled),)))
    observation = torch.randn(8, 4, generator=Streams(0).torch("x"))
    torch.testing.assert_close(policy(observation)[0], factor * core.policy(0)(observation)[0])
    twin = build(policy.blueprint())
    twin.load_state_dict(policy.state_dict())
    torch.testing.assert_close(twin(observation)[0], policy(observation)[0])


def test_a_match_of_other_specs_is_refused(untrained_core, specs):
    policy = wrap(untrained_core, specs[CARTPOLE])
    with pytest.raises(ConfigError, match=r"the match is not of InvertedPendulum-v5 and InvertedDoublePendulum-v5"):
        wrap(untrained_core, specs[IDP], match=policy.origin.match)


def test_auto_falls_back_to_random_where_nothing_matches(untrained_core, specs):
    assert "random; nothing is matched" in wrap(untrained_core, specs["Hopper-v5"]).describe()
    with pytest.raises(ConfigError, match=r"nothing in Hopper-v5 means what .*; use wrap.adapter=random"):
        wrap(untrained_core, specs["Hopper-v5"], adapter="semantic")


def test_a_sandwich_is_that_of_its_trainers_preset(untrained_core, specs):
    of = {algo: wrap(untrained_core, specs[IDP], algo=algo).config for algo in PRESETS}
    assert of == {algo: TrainConfig(IDP, algo=algo).wrap for algo in PRESETS}
    with pytest.raises(UnknownNameError, match="unknown trainer 'dyna'; did you mean dyna-ppo or dyna-ddpg"):
        wrap(untrained_core, specs[IDP], algo="dyna")


@pytest.mark.parametrize("tap", ["features", "action"])
@pytest.mark.parametrize("adapter", ["random", "semantic"])
@pytest.mark.parametrize("residual", [0, 8])
def test_every_sandwich_is_rebuilt_from_its_blueprint(untrained_core, specs, tap, adapter, residual):
    policy = wrap(untrained_core, specs[IDP], tap=tap, adapter=adapter, residual=residual, member=1)
    twin = build(policy.blueprint())
    twin.load_state_dict(policy.state_dict())
    observation = torch.randn(7, 9, generator=Streams(0).torch("x"))
    for a, b in zip(policy(observation), twin(observation), strict=True):
        assert torch.equal(a, b)
    grouped = [p for group in policy.parameter_groups() for p in group.parameters]
    assert {id(p) for p in grouped} == {id(p) for p in policy.parameters()}
    assert len(grouped) == len({id(p) for p in grouped})


def test_wrapping_leaves_the_core_alone_and_pairs_seeds(untrained_core, specs):
    before = copy.deepcopy(untrained_core.components)
    policy, same, other = (wrap(untrained_core, specs["Hopper-v5"], seed=seed) for seed in (3, 3, 4))
    assert torch.equal(policy.input_adapter.linear.weight, same.input_adapter.linear.weight)
    assert not torch.equal(policy.input_adapter.linear.weight, other.input_adapter.linear.weight)
    torch.nn.init.zeros_(policy.core.mean_head.weight)
    assert all(torch.equal(t, before[part][n]) for part, ts in untrained_core.components.items() for n, t in ts.items())


def test_staged_unfreezing_and_learning_rates(untrained_core, specs):
    policy = wrap(untrained_core, specs[IDP], freeze={"core": 0.5}, lr_scale={"core": 0.1, "input_adapter": 2.0})
    scales = {group.name: group.lr_scale for group in policy.parameter_groups()}
    assert scales["core"] == 0.1 and scales["input_adapter"] == 2.0 and scales["output_adapter"] == 1.0  # noqa: PT018
    policy.at_progress(0.4)
    assert not any(p.requires_grad for p in policy.core.parameters())
    assert policy.output_adapter.weight.requires_grad
    policy.at_progress(0.5)
    assert all(p.requires_grad for p in policy.core.parameters())


@pytest.mark.parametrize(
    ("options", "kind", "message"),
    [
        ({"freeze": {"cor": 1.0}}, UnknownNameError, r"unknown part in wrap.freeze 'cor'; did you mean core\?"),
        ({"lr_scale": {"cor": 1.0}}, UnknownNameError, r"unknown part in wrap.lr_scale 'cor'; did you mean core\?"),
        ({"tapp": "action"}, UnknownNameError, r"unknown option of wrap 'tapp'; did you mean tap"),
        ({"residual": -1}, SettingError, "wrap.residual=-1 must be at least 0"),
        ({"preset": "papr"}, UnknownNameError, "did you mean paper"),
    ],
    ids=["frozen part", "slow part", "option", "value", "preset"],
)
def test_wrong_options_are_refused(untrained_core, specs, options, kind, message):
    with pytest.raises(kind, match=message):
        wrap(untrained_core, specs[IDP], **options)


def test_a_core_whose_card_does_not_fit_is_refused(untrained_core, specs):
    wrong = Core("x-v1", specs[IDP], untrained_core.architecture, (0, 1), untrained_core.components)
    with pytest.raises(DimensionError, match="4 observations and 1 actions, its card says 9 and 1"):
        wrap(wrong, specs[IDP])


def test_a_scratch_policy_is_the_one_that_a_run_with_its_seed_begins_with():
    made, same, other = (
        scratch_policy("Hopper-v5", seed=3),
        *(new_policy(TrainConfig("Hopper-v5", seed=seed), None) for seed in (3, 4)),
    )
    assert all(torch.equal(value, same.state_dict()[name]) for name, value in made.state_dict().items())
    assert not torch.equal(made.network.body[0].weight, other.network.body[0].weight)
    assert (made.obs_dim, made.act_dim, made.network.architecture.hidden) == (11, 3, (64, 64))


def test_a_scratch_policy_has_the_network_that_is_asked_for():
    network = NetworkConfig(hidden=(8,), init_std=0.3, squash=True, normalize_observation=False)
    made = scratch_policy(Counter(3), network)
    mean, log_std = made(torch.full((2, 2), 1e9))
    assert (made.obs_dim, made.act_dim) == (2, 1)
    assert mean.abs().max() <= 1
    torch.testing.assert_close(log_std.exp(), torch.full((2, 1), 0.3))
    assert made.normalizer is None


def test_no_environment_no_policy():
    with pytest.raises(UnknownNameError, match="did you mean Hopper-v5"):
        scratch_policy("Hoper-v5")
    with pytest.raises(EnvironmentContractError, match="must be a flat and bounded Box"):
        scratch_policy("CartPole-v1")


def test_a_run_around_a_core_begins_with_the_presets_sandwich():
    core = load_core("inverted-pendulum-v1")
    config = TrainConfig("Hopper-v5", core=core.id, preset="paper", member=2)
    policy = new_policy(config, core)
    assert isinstance(policy, PaperSandwich)
    assert torch.equal(policy.core.mean_head.weight, core.network(2).mean_head.weight)


def test_a_constant_policy_is_rebuilt_from_its_blueprint():
    twin = build({"kind": "constant", "obs_dim": 3, "act_dim": 2})
    twin.load_state_dict({"bias": torch.tensor([0.5, -0.5]), "log_std": torch.tensor([0.0, 99.0])})
    mean, log_std = twin(torch.zeros(4, 3))
    assert mean.tolist() == [[0.5, -0.5]] * 4
    assert log_std.tolist() == [[0.0, 1.0]] * 4  # bounded


def test_a_core_explores_at_least_as_much_as_is_asked_for():
    core = load_core("half-cheetah-v1")
    own, wider = (wrap(core, "HalfCheetah-v5", preset="default-v3", least_std=least) for least in (0.0, 0.05))
    observation = torch.zeros(1, 17)
    torch.testing.assert_close(wider(observation)[0], own(observation)[0])
    assert own.log_std.exp().min() < 0.05
    torch.testing.assert_close(wider.log_std, own.log_std.clamp(min=math.log(0.05)))
    assert wrap(core, "HalfCheetah-v5").log_std.exp().min().item() == pytest.approx(0.2)


def test_a_member_is_one_of_the_cores():
    core = load_core("inverted-pendulum-v1")
    assert wrap(core, "InvertedDoublePendulum-v5", member=np.int64(4)).has_core
    for member in (5, -1, "0", 1.0, None):
        with pytest.raises(SettingError, match=r"member.* must be 0 to 4"):
            wrap(core, "InvertedDoublePendulum-v5", member=member)


def test_what_is_no_match_a_setting_or_a_folder_is_said():
    core, policy = load_core("inverted-pendulum-v1"), scratch_policy("InvertedPendulum-v5")
    budget = Budget(episodes=1)
    for call, message in (
        (lambda: wrap(core, "InvertedDoublePendulum-v5", match=5), "match is of type int and not str or Path or Pairing"),
        (lambda: train(policy, "InvertedPendulum-v5", budget, settings={5: 3}), "a setting's name is of type int"),
        (lambda: train(policy, "InvertedPendulum-v5", budget, out=5), "out is of type int"),
        (lambda: load_core(None), "name is of type NoneType"),
        (lambda: wrap(core, "InvertedPendulum-v5", member=True), "member=True must be 0 to"),
        (lambda: health(policy, "InvertedPendulum-v5", steps=0), "steps=0 must be at least 1"),
        (lambda: distill("inverted-pendulum-v1", "InvertedPendulum-v5", {}), "recipe is of type dict and not DistillConfig"),
        (lambda: load_policy(5), "run_dir is of type int"),
        (lambda: load_subject(None), "name is of type NoneType"),
        (lambda: evaluate(core, "InvertedPendulum-v5"), "policy is of type Core and cannot act"),
        (lambda: save_match(None, "x.yaml"), "pairing is of type NoneType"),
        (lambda: load_match(5), "path is of type int"),
    ):
        with pytest.raises(ConfigError, match=message):
            call()


def test_what_no_path_and_no_environment_can_be_is_one_line():
    policy, budget = scratch_policy(IP), Budget(episodes=1)
    for call, kind, message in (
        (
            lambda: train(policy, IP, budget, out="a\0b"),
            RunDirectoryError,
            "no folder has a name with a null character",
        ),
        (lambda: train(policy, IP, budget, out="a" * 300), RunDirectoryError, "File name too long"),
        (lambda: load_core("a" * 5000), UnknownNameError, "unknown core 'aaa"),
        (lambda: load_subject("a" * 5000), UnknownNameError, "unknown run or core 'aaa"),
        (
            lambda: make_env("Hopper-v5?frame_skip=-1"),
            EnvironmentContractError,
            "frame_skip of Hopper-v5=-1 must be a whole number, at least 1",
        ),
    ):
        with pytest.raises(kind, match=message):
            call()


def test_a_policy_is_of_the_robot_that_it_was_wrapped_onto():
    policy = wrap(load_core("hopper-v1"), "HalfCheetah-v5")  # 17 observations and 6 actions, as the other
    with pytest.raises(ConfigError, match="wrapped onto HalfCheetah-v5, and the numbers of Walker2d-v5 mean something else"):
        evaluate(policy, "Walker2d-v5", episodes=1)
    evaluate(policy, "HalfCheetah-v5?vary.mass=1.4", episodes=1, max_episode_steps=5)


def test_it_is_said_if_nothing_of_a_core_means_anything(caplog):
    wrap(load_core("hopper-v1"), "Reacher-v5")
    assert caplog.messages == ["nothing of hopper-v1 means anything on Reacher-v5: its adapters are random"]


def test_observations_of_any_numbers_are_taken_and_others_are_one_line():
    policy = scratch_policy("InvertedPendulum-v5")
    rows = np.ones((2, 4))
    np.testing.assert_array_equal(policy.act(rows), policy.act(rows.astype(np.float32)))
    for wrong in (rows[:, :3], rows[0], rows * 1j, "four"):
        with pytest.raises(DimensionError, match=r"must be of shape \(B, 4\) and of real numbers"):
            policy.act(wrong)
