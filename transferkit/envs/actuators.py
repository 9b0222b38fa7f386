"""What each element of the action drives, by what it does to the simulation."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from transferkit.envs.forms import digits_of
from transferkit.envs.labels import unique
from transferkit.physics import mujoco
from transferkit.spec import DRIVE, Actuator

if TYPE_CHECKING:
    from transferkit.envs.evidence import Responses
    from transferkit.envs.frozen import Look
    from transferkit.spec import Joint

SCALAR = (int(mujoco.mjtJoint.mjJNT_SLIDE), int(mujoco.mjtJoint.mjJNT_HINGE))
"""Joints of one degree of freedom."""

NEGLIGIBLE = 1e-6
"""Of the largest force on a degree of freedom."""


def read_actuators(
    low: NDArray, high: NDArray, responses: Responses, model: mujoco.MjModel, joints: Sequence[Joint]
) -> list[Actuator]:
    """Describe each element of the action, with the bounds `(act_dim,)` that the environment states."""
    rows = zip(low, high, responses.looks, strict=True)
    found = [_actuator(k, float(a), float(b), responses.none, looks, model, joints) for k, (a, b, looks) in enumerate(rows)]
    names = unique([actuator.name for actuator in found])
    return [replace(actuator, name=name) for actuator, name in zip(found, names, strict=True)]


def unknown_actuators(low: NDArray, high: NDArray) -> list[Actuator]:
    """Actuators of which only the bounds `(act_dim,)` are known."""
    return [_unknown(k, float(a), float(b)) for k, (a, b) in enumerate(zip(low, high, strict=True))]


def _unknown(k: int, low: float, high: float) -> Actuator:
    return Actuator(f"action{k}", f"action{k}", None, low, high, 1.0, 0.0, "")


def _actuator(
    k: int,
    low: float,
    high: float,
    none: Look,
    looks: Sequence[tuple[float, Look]],
    model: mujoco.MjModel,
    joints: Sequence[Joint],
) -> Actuator:
    driven = np.flatnonzero(np.any([look.control != none.control for _, look in looks], axis=0))
    model_name = "+".join(actuator_name(model, int(i)) for i in driven) or f"action{k}"
    dof = _only_dof(looks, none, driven, model)
    if dof is None:
        return replace(_unknown(k, low, high), name=model_name, model_name=model_name)
    joint = joints[dof]
    force = _steepest([(share, look.force[dof] - none.force[dof]) for share, look in looks])
    acceleration = _steepest([(share, look.acceleration[dof] - none.acceleration[dof]) for share, look in looks])
    return Actuator(
        DRIVE + joint.name,
        model_name,
        joint.name,
        low,
        high,
        float(f"{force / ((high - low) / 2):.6g}") + 0.0,
        round(acceleration, digits_of(abs(acceleration))) + 0.0,
        "N" if joint.type == "slide" else "N m",
    )


def _only_dof(looks: Sequence[tuple[float, Look]], none: Look, driven: NDArray[np.intp], model: mujoco.MjModel) -> int | None:
    """The one degree of freedom that an action pushes, or the one that its actuator is on."""
    forces = np.max([np.abs(look.force - none.force) for _, look in looks], axis=0, initial=0.0)
    pushed = np.flatnonzero(forces > NEGLIGIBLE * forces.max(initial=0.0))
    if len(pushed):
        return int(pushed[0]) if len(pushed) == 1 else None
    if len(driven) != 1 or int(model.actuator_trntype[driven[0]]) != int(mujoco.mjtTrn.mjTRN_JOINT):
        return None
    joint = int(model.actuator_trnid[driven[0], 0])
    return int(model.jnt_dofadr[joint]) if int(model.jnt_type[joint]) in SCALAR else None


def _steepest(effects: Sequence[tuple[float, float]]) -> float:
    """The largest effect per share: a clip flattens large actions, friction swallows small ones."""
    return float(max((effect / share for share, effect in effects), key=abs))


def actuator_name(model: mujoco.MjModel, actuator: int) -> str:
    """The name of an actuator in its model, or its number."""
    return model.actuator(actuator).name or f"actuator{actuator}"
