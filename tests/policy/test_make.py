import copy

import numpy as np
import pytest
import torch

from transferkit import load_core, wrap
from transferkit.envs import derive_spec
from transferkit.errors import ConfigError, DimensionError
from transferkit.nn import Architecture, Linear, PolicyNet
from transferkit.policy import build, health, match
from transferkit.policy.core import Core
from transferkit.run.streams import Streams

IDP, CARTPOLE = "InvertedDoublePendulum-v5", "dm_control/cartpole-balance-v0"


@pytest.fixture(scope="module")
def specs():
    return {name: derive_spec(name) for name in ("InvertedPendulum-v5", IDP, CARTPOLE, "Hopper-v5", "Pendulum-v1")}


def test_a_matched_policy_acts_as_the_core_would_in_the_similar_state(untrained_core, specs):
    """Lengths 0.3 m and 0.5 m to the pole's mass; Froude: x scales with 0.6, speed with sqrt(0.6), rate with 1/sqrt(0.6)."""
    policy = wrap(untrained_core, specs[CARTPOLE])
    x, angle, v, rate = 0.3, 2.5, -0.7, 1.1
    observation = torch.tensor([[x, np.cos(angle), np.sin(angle), v, rate]], dtype=torch.float32)
    similar = torch.tensor([[0.6 * x, angle, 0.6**0.5 * v, rate / 0.6**0.5]], dtype=torch.float32)
    gain = specs["InvertedPendulum-v5"].action[0].authority / specs[CARTPOLE].action[0].authority
    with torch.no_grad():
        expected = gain * untrained_core.policy(0)(similar)[0]
        torch.testing.assert_close(policy(observation)[0], expected, rtol=1e-4, atol=1e-5)


def test_the_way_back_turns_an_angle_into_its_sine_and_cosine(specs):
    found = match(specs[CARTPOLE], specs["InvertedPendulum-v5"])
    assert found.form == ("linear", "cos", "sin", "linear", "linear")
    assert found.scale == pytest.approx(5 / 3, rel=1e-4)


def test_what_cannot_be_matched_is_said(untrained_core, specs):
    text = wrap(untrained_core, specs[IDP]).describe()
    assert "atan2(hinge_y.sin, hinge_y.cos)" in text
    assert "hinge_y -> hinge_y" in text
    back = match(specs[IDP], specs["InvertedPendulum-v5"])
    unmatched = [e.name for e, form in zip(specs[IDP].observation, back.form, strict=True) if form == "none"]
    assert unmatched == ["hinge_y2.sin", "hinge_y2.cos", "hinge_y2.velocity", "observation[8]"]


def test_hanging_is_not_upright(specs):
    """Pendulums only match where the load rests on the same side of the hinge."""
    source = specs["InvertedPendulum-v5"]
    joints = [j if j.type == "slide" else type(j)(**{**j.__dict__, "rest": (0.0, 0.0, -1.0)}) for j in source.joints]
    hanging = type(source)(**{**source.__dict__, "joints": tuple(joints)})
    assert match(source, hanging).joints == {"slide_x": "slide_x"}


def test_auto_falls_back_to_random_where_nothing_matches(untrained_core, specs):
    assert "random; nothing is matched" in wrap(untrained_core, specs["Hopper-v5"]).describe()
    with pytest.raises(ConfigError, match="adapter='random'"):
        wrap(untrained_core, specs["Hopper-v5"], adapter="semantic")


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
    before = copy.deepcopy(untrained_core.parts)
    policy, same, other = (wrap(untrained_core, specs["Hopper-v5"], seed=seed) for seed in (3, 3, 4))
    assert torch.equal(policy.input_adapter.linear.weight, same.input_adapter.linear.weight)
    assert not torch.equal(policy.input_adapter.linear.weight, other.input_adapter.linear.weight)
    torch.nn.init.zeros_(policy.core.mean_head.weight)
    assert all(torch.equal(t, before[part][n]) for part, ts in untrained_core.parts.items() for n, t in ts.items())


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
    "options", [{"freeze": {"cor": 1.0}}, {"lr_scale": {"cor": 1.0}}, {"tapp": "action"}, {"residual": -1}]
)
def test_wrong_options_are_refused(untrained_core, specs, options):
    with pytest.raises(ConfigError):
        wrap(untrained_core, specs[IDP], **options)


def test_a_core_whose_card_does_not_fit_is_refused(untrained_core, specs):
    wrong = Core("x-v1", specs[IDP], untrained_core.architecture, (0, 1), untrained_core.parts)
    with pytest.raises(DimensionError, match="4 observations and 1 actions, its card says 9 and 1"):
        wrap(wrong, specs[IDP])


def paper_core(specs, seed=0):
    architecture = Architecture(4, 1, (128, 128), "relu", "head")
    state = PolicyNet(architecture, Streams(seed).torch("core")).state_dict()
    return Core("paper", specs["InvertedPendulum-v5"], architecture, (0,), {"policy": {n: t[None] for n, t in state.items()}})


def test_the_paper_sandwich_has_the_papers_parameters_and_layers(specs):
    """PPOPT on InvertedDoublePendulum: 17,476 parameters; layers recomputed by hand here."""
    policy = wrap(paper_core(specs), specs[IDP], preset="paper")
    assert sum(p.numel() for p in policy.parameters()) == 17_476
    observation = torch.randn(5, 9, generator=Streams(0).torch("x"))
    x = torch.relu(policy.input_finetune(policy.input_adapter(observation)))
    h = torch.relu(policy.core.body[2](torch.relu(policy.core.body[0](x))))
    mean = policy.mean_adapter(torch.relu(policy.output_finetune(policy.core.mean_head(h))))
    std = torch.relu(policy.output_finetune(policy.core.log_std_head(h).exp()))
    assert torch.allclose(policy(observation)[0], mean)
    assert torch.allclose(policy(observation)[1], policy.std_adapter(torch.log(std + 1e-6)))


def test_health_tells_the_papers_sandwich_from_the_default(specs):
    """The paper's shared ReLU cuts the core off in about two initialisations of five; the default's never does."""
    core = paper_core(specs)
    cut_off = [health(wrap(core, specs[IDP], preset="paper", seed=s), IDP, steps=100).core_gradient == 0 for s in range(20)]
    assert 4 <= sum(cut_off) <= 13
    sick = health(wrap(core, specs["Hopper-v5"], preset="paper", seed=cut_off.index(False)), "Hopper-v5", steps=100)
    assert sick.action_rank <= 1
    assert any("directions" in warning for warning in sick.warnings)
    for seed in range(5):
        well = health(wrap(core, specs["Hopper-v5"], seed=seed), "Hopper-v5", steps=100)
        assert well.core_gradient > 0
        assert well.action_rank == 3
        assert (well.std_low, well.std_high) == pytest.approx((0.6, 0.6))


def test_health_tells_actions_that_exploration_cannot_change():
    """Hanging, the pole is far from what the core has learnt on, so it pushes far beyond full force; upright it is not."""
    stuck, well = (wrap(load_core("inverted-pendulum-v1"), f"dm_control/cartpole-{task}-v0") for task in ("swingup", "balance"))
    sick = health(stuck, "dm_control/cartpole-swingup-v0", steps=200)
    assert sick.saturated > 0.9
    assert any("outside the limits" in warning for warning in sick.warnings)
    assert health(well, "dm_control/cartpole-balance-v0", steps=200).saturated < 0.1


def test_controls_keep_what_they_claim_to_keep(untrained_core):
    shuffled, random = untrained_core.shuffled(0), untrained_core.randomized(0)
    name = "body.0.weight"
    a, b = untrained_core.parts["policy"][name], shuffled.parts["policy"][name]
    assert not torch.equal(a, b)
    assert torch.equal(a.flatten(1).sort().values, b.flatten(1).sort().values)
    assert not torch.equal(a, random.parts["policy"][name])
    assert isinstance(random.network(1).mean_head, Linear)
