"""Isaac Lab's IO descriptors: read back, compared with the physics, and with numbers that stand in the models."""

import xml.etree.ElementTree as ET

import pytest
import yaml

from tests.cli.commands import run, run_json
from tests.export.test_leapp import ASSETS, lively
from transferkit.descriptors import compare, read_descriptor
from transferkit.envs import derive_spec
from transferkit.errors import ConfigError
from transferkit.export import export_descriptor
from transferkit.export.drives import read_model


@pytest.mark.parametrize("env", ["HalfCheetah-v5", "Hopper-v5", "dm_control/cheetah-run-v0"])
def test_it_is_read_back_and_agrees_with_the_physics(tmp_path, env):
    export_descriptor(lively(env), tmp_path / "io.yaml")
    rows = compare(read_descriptor(tmp_path / "io.yaml"), derive_spec(env))
    assert {row.verdict for row in rows} == {"agrees"}
    assert rows[-1].part == "period"


def test_it_holds_what_the_model_says(tmp_path, capsys):
    path = tmp_path / "io.yaml"
    said = run_json(capsys, "export", "half-cheetah-v1", "--out", str(tmp_path / "a.onnx"), "--descriptor", str(path))
    assert said["descriptor"] == str(path)
    data = yaml.safe_load(path.read_text())
    (action,) = data["actions"]
    assert action["name"] == "joint_effort_action"
    assert action["joint_names"] == ["bthigh", "bshin", "bfoot", "fthigh", "fshin", "ffoot"]
    assert action["scale"] == pytest.approx([120, 90, 60, 120, 60, 30])
    assert action["clip"][5] == pytest.approx([-30, 30])
    robot = data["articulations"]["robot"]
    assert robot["joint_names"][3:5] == ["bthigh", "bshin"]
    assert robot["default_joint_damping"][3:5] == [6.0, 4.5]
    assert robot["default_joint_pos_limits"][3] == pytest.approx([-0.52, 1.05])
    assert data["scene"] == {"decimation": 5, "dt": pytest.approx(0.05), "physics_dt": pytest.approx(0.01)}
    assert [(term["name"], term["shape"]) for term in data["observations"]["policy"]] == [
        ("joint_pos_rel", [8]),
        ("joint_vel_rel", [9]),
    ]


def test_gains_of_a_servo_are_those_at_its_joint(tmp_path):
    """A cart's servo of 50 N for a metre at the actuator, whose length is twice the cart's way."""
    tree = ET.parse(ASSETS / "inverted_pendulum.xml")
    (motor,) = tree.find("actuator")
    motor.tag = "position"
    motor.attrib = {"joint": "slider", "kp": "50", "kv": "3", "gear": "2", "name": "cart", "ctrlrange": "-1 1"}
    tree.write(tmp_path / "servo.xml")
    export_descriptor(lively(f"InvertedPendulum-v5?xml_file={tmp_path / 'servo.xml'}"), tmp_path / "io.yaml")
    data = yaml.safe_load((tmp_path / "io.yaml").read_text())
    (action,), robot = data["actions"], data["articulations"]["robot"]
    assert (action["name"], action["scale"], action["clip"]) == ("joint_position_action", [0.5], [[-0.5, 0.5]])
    assert robot["default_joint_stiffness"] == [200.0, 0.0]
    assert robot["default_joint_damping"][0] == pytest.approx(12.0 + 1.0)  # and the joint's own


def test_two_servos_of_a_joint_are_one_gain_and_two_commands(tmp_path):
    tree = ET.parse(ASSETS / "inverted_pendulum.xml")
    (motor,) = (drives := tree.find("actuator"))
    motor.tag, motor.attrib = "position", {"joint": "slider", "kp": "50", "name": "place", "ctrlrange": "-1 1"}
    ET.SubElement(drives, "velocity", {"joint": "slider", "kv": "3", "name": "speed", "ctrlrange": "-1 1"})
    tree.write(tmp_path / "servo.xml")
    env = f"InvertedPendulum-v5?xml_file={tmp_path / 'servo.xml'}"
    spec = derive_spec(env)
    model = read_model(env, spec)
    assert [drive.command for drive in model.drives] == ["position", "velocity"]
    assert model.gains(spec, spec.joints[0]) == (50.0, 3.0)


def test_a_family_is_exported_as_the_robot_that_it_is_drawn_around():
    env = "Hopper-v5?vary.gear=[0.5,2]&vary.damping=[0.5,3]"
    assert read_model(env, derive_spec(env)) == read_model("Hopper-v5", derive_spec("Hopper-v5"))


def test_what_drives_no_joint_is_an_action_of_its_own(tmp_path):
    tree = ET.parse(ASSETS / "inverted_pendulum.xml")
    root, drives = tree.getroot(), tree.find("actuator")
    for name in ("left", "right"):
        tendon = ET.SubElement(ET.SubElement(root, "tendon"), "fixed", {"name": name})
        ET.SubElement(tendon, "joint", {"joint": "slider", "coef": "1"})
        ET.SubElement(tendon, "joint", {"joint": "hinge", "coef": "0.1"})
        ET.SubElement(drives, "motor", {"tendon": name, "name": name, "ctrlrange": "-1 1"})
    tree.write(tmp_path / "tendons.xml")
    export_descriptor(lively(f"InvertedPendulum-v5?xml_file={tmp_path / 'tendons.xml'}"), tmp_path / "io.yaml")
    actions = yaml.safe_load((tmp_path / "io.yaml").read_text())["actions"]
    assert [(one["name"], one["full_path"].split(".")[0], one["joint_names"]) for one in actions] == [
        ("joint_effort_action", "isaaclab", ["slider"]),
        ("left", "transferkit", []),
        ("right", "transferkit", []),
    ]


def test_earlier_observations_and_functions_of_angles_are_terms_of_their_own(tmp_path):
    export_descriptor(lively("dm_control/cartpole-balance-v0?vary.frames=2"), tmp_path / "io.yaml")
    terms = yaml.safe_load((tmp_path / "io.yaml").read_text())["observations"]["policy"]
    assert [term["name"] for term in terms][-4:] == ["joint_pos_rel", "hinge_y.cos", "hinge_y.sin", "joint_vel_rel"]
    assert terms[0]["name"] == "slide_x.position[t-1]"


def test_what_cannot_be_written_is_one_line(tmp_path, capsys):
    with pytest.raises(ConfigError, match="whose joints could be named; leave out descriptor"):
        export_descriptor(lively("Pendulum-v1"), tmp_path / "io.yaml")
    files = "--leapp", str(tmp_path / "b.yaml"), "--descriptor", str(tmp_path / "b.yaml")
    code, _, said = run(capsys, "export", "inverted-pendulum-v1", "--out", str(tmp_path / "c.onnx"), *files)
    assert (code, "cannot be both descriptors" in said) == (2, True)
    assert not list(tmp_path.iterdir())
