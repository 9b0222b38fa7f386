"""Isaac Lab's IO descriptors of the network that `export_onnx` writes: terms of its observation and of its action, in order."""

from __future__ import annotations

import itertools
from pathlib import Path
from typing import TYPE_CHECKING, Any

from transferkit.config.checks import check_kind
from transferkit.descriptors.compare import observed
from transferkit.envs import derive_spec
from transferkit.errors import ConfigError
from transferkit.export.drives import read_model
from transferkit.files import check_new, new_file
from transferkit.record.play import Subject

if TYPE_CHECKING:
    from collections.abc import Sequence

    from transferkit.descriptors.compare import Measured
    from transferkit.export.drives import Drive, Model
    from transferkit.spec import Actuator, Element, IOSpec

TERMS = {"position": ("joint_pos_rel", "joint_pos_offsets", "rad"), "velocity": ("joint_vel_rel", "joint_vel_offsets", "rad/s")}
"""Isaac Lab's function, the name of its offsets, and its unit, by quantity of one joint."""

ACTIONS = {
    "torque": ("joint_effort_action", "JointEffortAction"),
    "position": ("joint_position_action", "JointPositionAction"),
    "velocity": ("joint_velocity_action", "JointVelocityAction"),
}


def export_descriptor(subject: Subject, path: str | Path) -> None:
    """Write Isaac Lab's IO descriptors: names of joints in order, scales, offsets, gains, default pose, time steps.

    What of the observation is no position or velocity of one joint is a term by the element's name. Units of slides are metres.

    Raises:
        ConfigError: the file exists or cannot be written, or the environment is not MuJoCo.
    """
    check_kind("subject", subject, Subject, "load it with load_subject")
    path = Path(path)
    check_new(path, "descriptor", ".yaml")
    spec = derive_spec(subject.env)
    model = read_model(subject.env, spec)
    if model is None:
        raise ConfigError(
            f"{spec.env_id} is not a MuJoCo environment, whose joints could be named", remedy="leave out {descriptor}"
        )
    period = spec.time_step * subject.policy.hold
    data = {
        "actions": _actions(spec, model.drives),
        "articulations": {"robot": _articulation(spec, model)},
        "observations": {"policy": _observations(spec)},
        "scene": {"decimation": round(period / model.physics_step), "dt": period, "physics_dt": model.physics_step},
    }
    import yaml  # noqa: PLC0415 - of few commands

    with new_file(path, "descriptor") as temporary:
        temporary.write_text(yaml.safe_dump(data, sort_keys=False, default_flow_style=None))


def _observations(spec: IOSpec) -> list[dict[str, Any]]:
    """Neighbours of one kind are one term."""
    pairs = list(zip(spec.observation, observed(spec), strict=True))
    groups = itertools.groupby(pairs, key=lambda pair: _kind(*pair))
    return [term for kind, group in groups for term in _terms(kind, list(group), spec)]


def _kind(element: Element, measured: Measured) -> str:
    if element.quantity == "action" and not element.age:
        return "action"
    return measured.quantity if measured.quantity in TERMS and len(measured.joints) == 1 and measured.scale else ""


def _terms(kind: str, pairs: Sequence[tuple[Element, Measured]], spec: IOSpec) -> list[dict[str, Any]]:
    if kind == "action" and [one.name for one, _ in pairs] == [actuator.acted for actuator in spec.action]:
        return [_term("last_action", len(pairs), "isaaclab.envs.mdp.observations.last_action")]
    if kind not in TERMS:
        return [_term(element.name, 1, f"transferkit.{element.quantity}", units=element.unit) for element, _ in pairs]
    name, offsets, unit = TERMS[kind]
    found = [measured for _, measured in pairs]
    scales = [one.scale for one in found]
    term = _term(name, len(found), f"isaaclab.envs.mdp.observations.{name}", None if set(scales) == {1.0} else scales, unit)
    return [term | {"joint_names": [one.joints[0].model_name for one in found], offsets: [one.zero for one in found]}]


def _term(name: str, size: int, path: str, scale: list[float] | None = None, units: str = "") -> dict[str, Any]:
    return {
        "name": name,
        "full_path": path,
        "mdp_type": "Observation",
        "dtype": "torch.float32",
        "shape": [size],
        "overloads": {"clip": None, "flatten_history_dim": True, "history_length": 0, "scale": scale},
        "extras": {"modifiers": None, "units": units},
    }


def _actions(spec: IOSpec, drives: Sequence[Drive]) -> list[dict[str, Any]]:
    """Neighbours whose commands are of one kind are one term."""
    names = spec.model_names
    groups = itertools.groupby(
        zip(spec.action, drives, strict=True), key=lambda pair: (pair[1].command, pair[0].joint is None and pair[0].name)
    )
    return [_action(command, list(group), names) for (command, _), group in groups]


def _action(command: str, pairs: Sequence[tuple[Actuator, Drive]], names: dict[str, str]) -> dict[str, Any]:
    """Isaac Lab's action of joints, or one under our name for what drives none."""
    joints = [names[one.joint] for one, _ in pairs if one.joint is not None]
    known = ACTIONS.get(command) if joints else None
    name, function = known or (pairs[0][0].name, command)
    scales = [1.0 if known is None else one.gear if command == "torque" else 1 / drive.gear for one, drive in pairs]
    ends = [sorted((scale * one.low, scale * one.high)) for scale, (one, _) in zip(scales, pairs, strict=True)]
    return {
        "name": name,
        "full_path": f"isaaclab.envs.mdp.actions.joint_actions.{function}" if known else f"transferkit.{function}",
        "mdp_type": "Action",
        "action_type": "JointAction",
        "dtype": "torch.float32",
        "shape": [len(pairs)],
        "joint_names": joints if known else [],
        "scale": scales,
        "offset": 0.0,
        "clip": ends,
    }


def _articulation(spec: IOSpec, model: Model) -> dict[str, Any]:
    """Of all joints; gains are those of servos, without which a joint has none."""
    gains = [model.gains(spec, joint) for joint in spec.joints]
    return {
        "joint_names": [joint.model_name for joint in spec.joints],
        "default_joint_pos": [joint.reference for joint in spec.joints],
        "default_joint_vel": [0.0] * len(spec.joints),
        "default_joint_pos_limits": [list(joint.range) if joint.range else None for joint in spec.joints],
        "default_joint_stiffness": [stiffness for stiffness, _ in gains],
        "default_joint_damping": [passive + damping for passive, (_, damping) in zip(model.joints.damping, gains, strict=True)],
        "default_joint_friction": list(model.joints.friction),
        "default_joint_armature": list(model.joints.armature),
    }
