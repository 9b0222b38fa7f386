"""How the actuators of an environment's model turn controls into forces on joints, and what the joints do by themselves."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING, Literal

from transferkit.envs import open_simulation, opened
from transferkit.envs.actuators import actuator_name
from transferkit.envs.vary import nominal
from transferkit.physics import mujoco

if TYPE_CHECKING:
    from transferkit.envs import EnvLike
    from transferkit.spec import IOSpec, Joint

FIXED, AFFINE = int(mujoco.mjtGain.mjGAIN_FIXED), int(mujoco.mjtBias.mjBIAS_AFFINE)


@dataclass(frozen=True)
class Drive:
    """An actuator of the action."""

    command: Literal["torque", "position", "velocity", "other"]
    """What its control is: a torque or force, the goal of a servo, or something with a state of its own."""
    gear: float = 1.0
    """Of its transmission: a goal of the servo is the joint's position, or velocity, times this."""
    stiffness: float = 0.0
    """Of a servo, at the joint: N m/rad, or N/m."""
    damping: float = 0.0
    """Of a servo, at the joint: N m s/rad, or N s/m."""


@dataclass(frozen=True)
class Joints:
    """Passive properties of joints, in the order of the spec."""

    damping: tuple[float, ...]
    friction: tuple[float, ...]
    armature: tuple[float, ...]


@dataclass(frozen=True)
class Model:
    """What exports say of a model beside the spec."""

    drives: tuple[Drive, ...]
    """In the order of the action."""
    joints: Joints
    physics_step: float
    """Seconds."""

    def gains(self, spec: IOSpec, joint: Joint) -> tuple[float, float]:
        """Stiffness and damping of all servos that drive a joint, together."""
        own = [drive for one, drive in zip(spec.action, self.drives, strict=True) if one.joint == joint.name]
        return sum(drive.stiffness for drive in own), sum(drive.damping for drive in own)


def read_model(env: EnvLike, spec: IOSpec) -> Model | None:
    """Read the model behind an environment; None if it is not MuJoCo."""
    with opened(env) as made, nominal(made):
        simulation = open_simulation(made)
        if simulation is None:
            return None
        made.reset(seed=0)
        model = simulation.model
        ids = {actuator_name(model, k): k for k in range(model.nu)}
        drives = [_drive(model, ids.get(one.model_name)) for one in spec.action]
        passive = Joints(*(tuple(map(float, row)) for row in (model.dof_damping, model.dof_frictionloss, model.dof_armature)))
        return Model(tuple(drives), passive, float(model.opt.timestep))


def _drive(model: mujoco.MjModel, actuator: int | None) -> Drive:
    """Describe an actuator; a servo's force is `gain * control + bias[1] * length + bias[2] * velocity`, at the actuator."""
    if actuator is None or model.actuator_dyntype[actuator] or model.actuator_gaintype[actuator] != FIXED:
        return Drive("other")
    gain, (constant, position, velocity) = model.actuator_gainprm[actuator, 0], model.actuator_biasprm[actuator, :3]
    gear = float(model.actuator_gear[actuator, 0])
    if not (constant or position or velocity):
        return Drive("torque", gear)
    at_joint = {"stiffness": -float(position) * gear**2, "damping": -float(velocity) * gear**2}
    if model.actuator_biastype[actuator] != AFFINE or constant:
        return Drive("other", gear)
    if position == -gain:
        return Drive("position", gear, **at_joint)
    return Drive("velocity", gear, **at_joint) if velocity == -gain and not position else Drive("other", gear)
