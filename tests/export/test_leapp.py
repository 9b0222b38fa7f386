"""A policy as LEAPP YAML, driven by the program of the docs, which knows only the file."""

import math
import re
import xml.etree.ElementTree as ET
from dataclasses import replace
from pathlib import Path

import gymnasium
import pytest
import torch
import yaml

from tests.cli.commands import run, run_json
from transferkit import load_subject
from transferkit.descriptors import compare, read_descriptor
from transferkit.envs import derive_spec, make_env, opened, rollout
from transferkit.errors import ConfigError
from transferkit.export import export_leapp
from transferkit.export.deployed import Deployed
from transferkit.export.onnx_file import exported_policy
from transferkit.export.ports import ports_of
from transferkit.nn import Architecture
from transferkit.policy.base import ScratchPolicy
from transferkit.record.play import Subject
from transferkit.streams import Streams

ASSETS = Path(gymnasium.__file__).parent / "envs" / "mujoco" / "assets"
PAGE = Path(__file__).parents[2] / "docs" / "deploy.md"


def lively(env):
    """An untrained policy that moves all joints."""
    spec = derive_spec(env)
    policy = ScratchPolicy.create(
        Architecture(spec.obs_dim, spec.act_dim, (32,)), Streams(0).torch("policy"), init_std=1.0, normalize=True
    )
    torch.nn.init.normal_(policy.network.mean_head.weight, std=0.5, generator=Streams(1).torch("head"))
    return Subject(policy, env)


@pytest.fixture
def program(tmp_path, monkeypatch):
    """The docs' program."""
    monkeypatch.chdir(tmp_path)
    (code,) = re.findall(r"(?ms)^:caption: deployed.py\n(.*?)^```$", PAGE.read_text())
    names = {}
    exec(compile(code, "deployed.py", "exec"), names)
    return names["run"]


def reordered(path):
    """HalfCheetah's XML with the front leg before the back one, and its motors the other way round."""
    tree = ET.parse(ASSETS / "half_cheetah.xml")
    torso = tree.find(".//body[@name='torso']")
    legs = torso.findall("body")
    for leg in legs:
        torso.remove(leg)
    torso.extend(legs[::-1])
    motors = tree.find("actuator")
    motors[:] = motors[::-1]
    tree.write(path)


def test_an_angle_keeps_what_is_added_to_it():
    spec = derive_spec("InvertedDoublePendulum-v5")
    k = [one.quantity for one in spec.observation].index("cos")
    turned = replace(spec.observation[k], offset=0.5)
    spec = replace(spec, observation=(*spec.observation[:k], turned, *spec.observation[k + 1 :]))
    deployed = Deployed(lambda observation: observation[:, k : k + 1], ports_of(spec), spec)
    measured = [torch.full((1, size), 0.25) for size in deployed.inputs.values()]
    angle = 0.25 * sum(turned.coefficients)
    assert float(deployed(*measured)[0] / deployed.gear) == pytest.approx(math.cos(angle + 0.5))


def test_a_program_that_knows_only_the_file_drives_another_xml_of_the_robot_alike(tmp_path, program):
    subject = lively("HalfCheetah-v5?reset_noise_scale=0")
    export_leapp(subject, tmp_path / "cheetah.yaml")
    reordered(tmp_path / "other.xml")
    env = make_env(subject.env)
    observation = env.reset(seed=0)[0]
    for _ in range(10):  # an untrained robot is soon chaotic
        action = subject.policy.act(observation[None])[0].clip(-1.0, 1.0)
        observation = env.step(action)[0]
    own = env.unwrapped
    expected = {own.model.joint(k).name: own.data.qpos[k] for k in range(own.model.nq)}
    reached = program("cheetah.yaml", str(tmp_path / "other.xml"), 0.5)
    assert list(reached) != list(expected)
    assert reached == pytest.approx(expected, abs=1e-4)
    assert max(map(abs, expected.values())) > 0.1


def test_a_trained_robot_runs_as_far_in_another_xml(tmp_path, program):
    """The reward of the cheetah is how far it comes, and its controls are the same: so is its return."""
    subject = load_subject("half-cheetah-v1", env="HalfCheetah-v5?reset_noise_scale=0", member=2)
    export_leapp(subject, tmp_path / "cheetah.yaml")
    reordered(tmp_path / "other.xml")
    with opened(subject.env) as env:
        for _ in rollout(subject.policy, [env], lambda _: 0, episodes=1):
            own = float(env.unwrapped.data.qpos[0])
    reached = program("cheetah.yaml", str(tmp_path / "other.xml"), 50.0)["rootx"]
    assert own > 250
    assert reached == pytest.approx(own, rel=0.1)


@pytest.mark.parametrize(
    "env",
    ["dm_control/walker-walk-v0", "Reacher-v5", "tests.toys:Remembering"],
)
def test_what_is_measured_makes_the_observation(env):
    """Angles of sums, distances, and what is remembered of earlier steps and actions."""
    subject = lively(env)
    spec = derive_spec(env)
    deployed = Deployed(exported_policy(subject, spec), ports_of(spec), spec)
    made = make_env(env)
    observation, fed = made.reset(seed=0)[0], {}
    joints = {joint.model_name: k for k, joint in enumerate(spec.joints)}
    for _ in range(6):
        simulation = made.unwrapped.physics if hasattr(made.unwrapped, "physics") else made.unwrapped
        state = {"joint_positions": simulation.data.qpos, "joint_velocities": simulation.data.qvel}
        ports = {"joint_positions": deployed.ports.positions, "joint_velocities": deployed.ports.velocities}
        given = {name: torch.tensor([[state[name][joints[one]] for one in names]]).float() for name, names in ports.items()}
        named = dict(zip((element.name for element in spec.observation), observation, strict=True))
        given["others"] = torch.tensor([[named[name] for name in deployed.ports.others]]).float()
        before = {name: size for name, size in deployed.inputs.items() if name.endswith("before")}
        first = {"measured_before": torch.cat(list(given.values()), -1)}  # this environment repeats what it begins with
        zero = {name: torch.zeros(1, size) for name, size in before.items()}
        given |= {name: fed.get(f"{name}_next", first.get(name, zero[name])) for name in before}
        with torch.no_grad():
            results = deployed(*(given[name] for name in deployed.inputs))
            control = exported_policy(subject, spec)(torch.from_numpy(observation)[None])
        fed = dict(zip(deployed.outputs, results, strict=True))
        torch.testing.assert_close(fed["torques"], control * deployed.gear, rtol=1e-4, atol=1e-4)
        observation = made.step(subject.policy.act(observation[None])[0].clip(-1, 1))[0]


def test_the_file_is_read_back_and_agrees_with_the_physics(tmp_path, capsys):
    path = tmp_path / "hopper.yaml"
    said = run_json(capsys, "export", "inverted-pendulum-v1", "--out", str(tmp_path / "pole.onnx"), "--leapp", str(path))
    assert (said["leapp"], said["leapp_network"]) == (str(path), str(tmp_path / "hopper.onnx"))
    descriptor = read_descriptor(path)
    assert descriptor.period == pytest.approx(0.04)
    rows = {(row.part, row.index): (row.verdict, row.detail) for row in compare(descriptor, derive_spec("InvertedPendulum-v5"))}
    assert rows.pop(("action", 0)) == ("scale", "1 against 100 N m for 1")  # torques, and not controls
    assert {verdict for verdict, _ in rows.values()} == {"agrees"}
    assert yaml.safe_load(path.read_text())["models"]["policy"]["parameters"]["model_path"] == "hopper.onnx"


def test_what_cannot_be_written_is_refused_before_anything_is(tmp_path, capsys):
    subject = load_subject("inverted-pendulum-v1")
    (tmp_path / "a.onnx").write_bytes(b"")
    with pytest.raises(ConfigError, match=r"a\.onnx exists"):
        export_leapp(subject, tmp_path / "a.yaml")
    files = "--out", str(tmp_path / "b.onnx"), "--leapp", str(tmp_path / "b.yaml")
    code, _, said = run(capsys, "export", "inverted-pendulum-v1", *files)
    assert (code, "needs the file" in said) == (2, True)
    assert not (tmp_path / "b.yaml").exists()


def test_a_servo_is_not_written_as_a_motor(tmp_path):
    tree = ET.parse(ASSETS / "inverted_pendulum.xml")
    (motor,) = tree.find("actuator")
    motor.tag, motor.attrib = "position", {"joint": "slider", "kp": "50", "name": "cart", "ctrlrange": "-1 1"}
    tree.write(tmp_path / "servo.xml")
    subject = lively(f"InvertedPendulum-v5?xml_file={tmp_path / 'servo.xml'}")
    with pytest.raises(ConfigError, match="actuator cart has gains"):
        export_leapp(subject, tmp_path / "a.yaml")
    assert not list(tmp_path.glob("a.*"))


def test_names_that_would_stand_for_several_numbers_are_refused(tmp_path):
    tree = ET.parse(ASSETS / "inverted_pendulum.xml")
    ET.SubElement(tree.find("actuator"), "motor", joint="slider", gear="-3", ctrlrange="-1 1")
    tree.write(tmp_path / "two.xml")
    for env, why in (
        ("Ant-v5", "joint root moves in several ways"),
        (f"InvertedPendulum-v5?xml_file={tmp_path / 'two.xml'}", "several actuators drive joint slider"),
    ):
        with pytest.raises(ConfigError, match=why):
            export_leapp(lively(env), tmp_path / "a.yaml")
    assert not list(tmp_path.glob("a.*"))


def test_a_policy_that_acts_more_rarely_than_it_remembers_is_refused(tmp_path):
    subject = lively("InvertedPendulum-v5?vary.frames=2")
    subject.policy.hold = 2
    with pytest.raises(ConfigError, match="acts once in 2 control steps"):
        export_leapp(subject, tmp_path / "a.yaml")
    assert not list(tmp_path.glob("a.*"))


def test_leapp_itself_takes_the_file(tmp_path, monkeypatch):
    """Its loader checks hashes, flows and names, and runs the network."""
    import leapp

    monkeypatch.chdir(tmp_path)
    subject = lively("tests.toys:Remembering")
    export_leapp(subject, tmp_path / "pole.yaml")
    manager = leapp.InferenceManager("pole.yaml")
    given = manager.get_mock_input()
    first, second = (manager(given)["policy/torques"].clone() for _ in range(2))
    spec = derive_spec(subject.env)
    deployed = Deployed(exported_policy(subject, spec), ports_of(spec), spec)
    values = [given[f"policy/{name}"] for name in ("joint_positions", "joint_velocities")]
    with torch.no_grad():
        torques, *back = deployed(*values, torch.zeros(1, 4), torch.zeros(1, 1))
        torch.testing.assert_close(first, torques, rtol=1e-4, atol=1e-4)
        torch.testing.assert_close(second, deployed(*values, *back)[0], rtol=1e-4, atol=1e-4)
