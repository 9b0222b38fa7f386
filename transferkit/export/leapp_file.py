"""NVIDIA's LEAPP YAML beside a network of its own, whose ports are joint positions and velocities and not an observation."""

from __future__ import annotations

import hashlib
import platform
from collections import Counter
from pathlib import Path
from typing import TYPE_CHECKING, Any

import torch

from transferkit.config.checks import check_kind
from transferkit.envs import derive_spec
from transferkit.errors import ConfigError
from transferkit.export.deployed import Deployed
from transferkit.export.drives import read_model
from transferkit.export.onnx_file import exported_policy, onnx_program
from transferkit.export.ports import ports_of
from transferkit.files import check_new, new_file
from transferkit.record.play import Subject

if TYPE_CHECKING:
    from collections.abc import Iterable, Sequence

    from transferkit.envs import EnvLike
    from transferkit.spec import IOSpec

VERSION = "1.3"
"""Of the format; its first with a frequency."""

NODE = "policy"

KINDS = {
    "joint_positions": "state/joint/position",
    "joint_velocities": "state/joint/velocity",
    "torques": "target/joint/torques",
}


def export_leapp(subject: Subject, path: str | Path) -> Path:
    """Write a policy as LEAPP YAML and the ONNX file that it names, beside it; returns the latter's path.

    Actions are torques of joints (forces of slides). What is remembered of earlier steps is fed back, and zero at first.

    Raises:
        ConfigError: a file exists or cannot be written, an action drives no joint or is no motor's, or ONNX is not installed.
    """
    check_kind("subject", subject, Subject, "load it with load_subject")
    path = Path(path)
    network = path.with_suffix(".onnx")
    check_new(path, "leapp", ".yaml")
    check_new(network, "leapp")
    spec = derive_spec(subject.env)
    _check(subject, spec)
    deployed = Deployed(exported_policy(subject, spec), ports_of(spec), spec).eval()
    examples = tuple(torch.zeros(1, size) for size in deployed.inputs.values())
    program = onnx_program(deployed, examples, list(deployed.inputs), list(deployed.outputs))
    data = program.model_proto.SerializeToString()
    with new_file(network, "leapp") as temporary:
        temporary.write_bytes(data)
    with new_file(path, "leapp") as temporary:
        temporary.write_text(_text(_described(deployed, spec, network.name, data, subject.policy.hold)))
    return network


def _check(subject: Subject, spec: IOSpec) -> None:
    """Refuse what LEAPP has no words for."""
    if without := [actuator.name for actuator in spec.action if actuator.joint is None]:
        raise ConfigError(f"action {without[0]} drives no joint, which LEAPP has no kind for", remedy="leave out {leapp}")
    if (servo := _servo(subject.env, spec)) is not None:
        raise ConfigError(
            f"actuator {servo} has gains or a state of its own, and a torque is not what it takes", remedy="leave out {leapp}"
        )
    joints = spec.model_names
    if (shared := _repeated(joints.values())) is not None:
        raise ConfigError(f"joint {shared} moves in several ways, whose numbers LEAPP names alike", remedy="leave out {leapp}")
    if (shared := _repeated(joints[str(actuator.joint)] for actuator in spec.action)) is not None:
        raise ConfigError(f"several actuators drive joint {shared}: LEAPP has one torque for it", remedy="leave out {leapp}")
    if subject.policy.hold > 1 and any(element.age for element in spec.observation):
        raise ConfigError(
            f"the policy acts once in {subject.policy.hold} control steps and sees single earlier ones: LEAPP cannot say it",
            remedy="leave out {leapp}",
        )


def _repeated(names: Iterable[str]) -> str | None:
    return next((name for name, count in Counter(names).items() if count > 1), None)


def _servo(env: EnvLike, spec: IOSpec) -> str | None:
    """Name the first actuator that is no motor: its force depends on more than its control."""
    model = read_model(env, spec)
    drives = () if model is None else zip(spec.action, model.drives, strict=True)
    return next((actuator.model_name for actuator, drive in drives if drive.command != "torque"), None)


def _described(deployed: Deployed, spec: IOSpec, file: str, data: bytes, hold: int) -> dict[str, Any]:
    joints = spec.model_names
    names = {
        "joint_positions": deployed.ports.positions,
        "joint_velocities": deployed.ports.velocities,
        "others": deployed.ports.others,
        "torques": [joints[str(actuator.joint)] for actuator in spec.action],
    }
    inputs, outputs = ([_port(*one, names) for one in side.items()] for side in (deployed.inputs, deployed.outputs))
    back = [name for name in deployed.inputs if name.endswith("before")]
    hashes = {"md5sum": hashlib.md5(data, usedforsecurity=False).hexdigest(), "sha256sum": hashlib.sha256(data).hexdigest()}
    pipeline: dict[str, Any] = {
        "data_flow": {},
        "feedback_flow": {f"{NODE}/{name}_next": [f"{NODE}/{name}"] for name in back},
        "inputs": {NODE: [name for name in deployed.inputs if name not in back]},
        "outputs": {NODE: ["torques"]},
    }
    if spec.time_step:
        pipeline["configs"] = {"frequency": 1.0 / (spec.time_step * hold)}
    return {
        "models": {
            NODE: {"inputs": inputs, "outputs": outputs, "parameters": {"model_path": file, **hashes, "backend": "onnx"}}
        },
        "pipeline": pipeline,
        "system information": {"leapp config version": VERSION, "os": platform.system()},
    }


def _port(name: str, size: int, names: dict[str, Sequence[str]]) -> dict[str, Any]:
    port: dict[str, Any] = {"name": name, "dtype": "float32", "shape": [1, size], "type": "tensor"}
    if name in KINDS:
        port["kind"] = KINDS[name]
    return port | ({"element_names": [None, list(names[name])]} if name in names else {})


def _text(data: dict[str, Any]) -> str:
    import yaml  # noqa: PLC0415 - of few commands

    return "\n".join(yaml.safe_dump({key: value}, sort_keys=False, default_flow_style=None) for key, value in data.items())
