"""Descriptors of other stacks, against the physics of an environment."""

import itertools
from dataclasses import replace

import pytest
import torch

from tests.cli.commands import run, run_json
from tests.descriptors.files import DEGREES, isaac, leapp
from transferkit.descriptors import compare, read_descriptor, remap
from transferkit.descriptors.compare import observed
from transferkit.envs import derive_spec
from transferkit.errors import ArtifactError
from transferkit.interop.build import build_core
from transferkit.interop.described import described
from transferkit.interop.foreign import Foreign, Given, Layer, Statistics
from transferkit.reading import FormatError
from transferkit.spec import Element


@pytest.fixture(scope="module")
def hopper():
    return derive_spec("Hopper-v5")


def verdicts(descriptor, spec):
    return {(row.part, row.index): (row.verdict, row.detail) for row in compare(descriptor, spec)}


def test_a_descriptor_in_the_environments_order_agrees_but_for_the_unit_of_actions(tmp_path, hopper):
    found = verdicts(read_descriptor(leapp(tmp_path / "hopper.yaml")), hopper)
    assert {key for key, (verdict, _) in found.items() if verdict != "agrees"} == {("action", k) for k in range(3)}
    assert found["action", 0] == ("scale", "1 against 200 N m for 1")
    assert found["period", 0] == ("agrees", "")


def test_order_unit_default_pose_and_period_are_told_apart(tmp_path, hopper):
    swapped = ("rootz", "rooty", "leg_joint", "thigh_joint", "foot_joint")
    found = verdicts(read_descriptor(leapp(tmp_path / "hopper.yaml", position=swapped, frequency=50)), hopper)
    assert found["observation", 2] == ("order", "the environment has it at 3")
    assert found["observation", 4] == ("agrees", "")
    assert found["period", 0][0] == "scale"
    right = ("thigh_joint", "leg_joint", "foot_joint")
    found = verdicts(read_descriptor(isaac(tmp_path / "a.yaml", joints=right, scale=-200.0)), hopper)
    assert found["observation", 2] == ("zero", "0.1 against 0")
    assert found["action", 1] == ("sign", "-200 against 200")
    found = verdicts(read_descriptor(isaac(tmp_path / "b.yaml", joints=right, degrees=True)), hopper)
    assert found["observation", 3] == ("unit", "degrees against radians; zero -0.4 against 0")


@pytest.mark.parametrize("normalized", [False, True])
@pytest.mark.parametrize("degrees", [False, True])
def test_a_policy_is_turned_to_the_environments_numbers(tmp_path, hopper, normalized, degrees):
    """Observations are made by hand in the descriptor's order, units and pose; the policy as it is says what is right."""
    pose = (0.1, -0.4, 0.2)
    path = isaac(tmp_path / "hopper.yaml", pose=pose, degrees=degrees)
    draw = torch.Generator().manual_seed(0)
    sizes = (11, 16, 3)
    layers = [
        Layer(*(torch.randn(*s, generator=draw).double() * 0.3 for s in ((b, a), (b,)))) for a, b in itertools.pairwise(sizes)
    ]
    mean, var = torch.randn(11, generator=draw).double(), torch.rand(11, generator=draw).double() + 0.5
    statistics = Statistics(mean, var, None, 1.0) if normalized else None
    foreign = Foreign("test", layers, "tanh", None, statistics=statistics, normalized=normalized)
    turned, notes = described(foreign, hopper, Given(descriptor=path))
    core, _ = build_core(turned, hopper, Given(std=0.3), "hopper", "")
    q, v = torch.randn(20, 5, generator=draw).double() * 0.3, torch.randn(20, 6, generator=draw).double()
    by_hand = torch.cat(
        [
            q[:, :2],
            (q[:, [4, 2, 3]] - torch.tensor(pose).double()) * (DEGREES if degrees else 1.0),
            v[:, :3],
            v[:, [5, 3, 4]],
        ],
        1,
    )
    x = (by_hand - mean) / var.sqrt() if normalized else by_hand
    torques = 100.0 * (torch.tanh(x @ layers[0].weight.T + layers[0].bias) @ layers[1].weight.T + layers[1].bias)
    controls = torques[:, [1, 2, 0]] / 200.0  # of thigh, leg and foot
    own = core.policy()(torch.cat([q, v], 1).float())[0].double()
    torch.testing.assert_close(own, controls, rtol=1e-4, atol=1e-4)
    assert any("turns them as the descriptor says" in note for note in notes)


def test_what_the_environment_does_not_have_is_said_and_nothing_is_reordered(tmp_path, hopper):
    descriptor = read_descriptor(isaac(tmp_path / "hopper.yaml", joints=("hip", "leg_joint", "foot_joint")))
    assert verdicts(descriptor, hopper)["observation", 2] == ("missing", "the environment has no such number")
    assert remap(descriptor, hopper) is None


def test_commands_that_no_order_or_unit_mends_are_not_mended(tmp_path, hopper):
    descriptor = read_descriptor(isaac(tmp_path / "hopper.yaml"))
    assert remap(descriptor, hopper) is not None
    first, *others = descriptor.action
    for action in ((replace(first, zero=0.5), *others), (first, first, others[0])):
        assert remap(replace(descriptor, action=action), hopper) is None


def test_an_action_of_the_other_sign_keeps_its_exploration(tmp_path, hopper):
    layers = [Layer(torch.zeros(b, a).double(), torch.zeros(b).double()) for a, b in ((11, 8), (8, 3))]
    foreign = Foreign("test", layers, "tanh", None, normalized=False, log_std=torch.full((3,), -1.0).double())
    turned, _ = described(foreign, hopper, Given(descriptor=isaac(tmp_path / "hopper.yaml", scale=-200.0)))
    core, _ = build_core(turned, hopper, Given(), "hopper", "")
    torch.testing.assert_close(core.policy()(torch.zeros(1, 11))[1], torch.full((1, 3), -1.0))


def test_an_action_of_before_is_found_by_its_whole_name():
    spec = derive_spec("Reacher-v5")
    joints = [one for one in spec.joints if one.name in ("hinge_z", "hinge_z2")]
    past = tuple(Element(f"drive.{joint.name}.action", "action", (), (), 0.0, "") for joint in joints)
    found = observed(replace(spec, observation=past))
    assert [one.joints for one in found] == [(joint,) for joint in joints]


@pytest.mark.parametrize(
    ("text", "said"),
    [
        ("models: {}\npipeline: {}", "it has 0 models, one is read"),
        ("actions: []\nobservations: {}", "it has the groups of observations"),
        ("a: 1", "it has neither models"),
        ("actions: 3\nobservations: {}", "Expected `array`, got `int`"),
        ("actions: [{name: joint_effort_action, joint_names: [a], scale: x}]\nobservations: {policy: []}", "Expected `arr"),
        ("observations: {policy: [{name: joint_pos}]}\nactions: []", "has neither a shape nor joint names"),
        ("a: &a [1]\nb: &b [*a, *a]\nc: [*b, *b]", "its references stand for more"),
        (
            "models: {p: {inputs: [{name: a, shape: [2], element_names: [a]}], outputs: []}}\npipeline: {}",
            "1 element names",
        ),
        (f"a: &a [{'1, ' * 1000}1]\nb: [{'*a, ' * 100}*a]", "its references stand for more"),
        (f"a: &a [&b [{'1, ' * 1000}1]]\nb: [{'*b, ' * 100}*b]", "its references stand for more"),
        ("models: {p: {inputs: [{name: a, shape: [65536, 65536]}], outputs: []}}\npipeline: {}", "a has 4294967296 numbers"),
        (
            "observations: {policy: [{name: a, shape: [9], overloads: {history_length: 999}}]}\nactions: []",
            "a has 8991 numbers, at most 4096 are supported",
        ),
        ("{", "not YAML"),
    ],
)
def test_what_is_no_descriptor_costs_one_line(tmp_path, text, said):
    (tmp_path / "bad.yaml").write_text(text)
    with pytest.raises(ArtifactError, match="is not read: ") as error:
        read_descriptor(tmp_path / "bad.yaml")
    assert said in str(error.value)
    assert "\n" not in str(error.value)


def test_the_command_shows_the_table(tmp_path, capsys):
    path = isaac(tmp_path / "hopper.yaml")
    text = run(capsys, "match", str(path), "Hopper-v5")[1]
    assert "joint position foot_joint   position of thigh_joint  order" in text
    rows = run_json(capsys, "match", str(path), "Hopper-v5")
    assert rows["mendable"] is True
    code, _, said = run(capsys, "match", str(path), "Hopper-v5", "--hold", "2")
    assert (code, "a descriptor is compared, and not matched; leave out --hold" in said) == (2, True)


def test_a_policy_behind_tanh_cannot_have_other_units_than_the_bounds(tmp_path, hopper):
    layers = [Layer(torch.zeros(n, m).double(), torch.zeros(n).double()) for m, n in ((11, 4), (4, 3))]
    foreign = Foreign("test", layers, "tanh", "bounds", squash=True, normalized=False)
    for scale, fits in ((200.0, True), (100.0, False)):
        turned, _ = described(foreign, hopper, Given(descriptor=isaac(tmp_path / "hopper.yaml", scale=scale)))
        if fits:
            build_core(turned, hopper, Given(std=0.3), "hopper", "")
        else:
            with pytest.raises(FormatError, match="by tanh"):
                build_core(turned, hopper, Given(std=0.3), "hopper", "")
