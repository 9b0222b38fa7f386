"""What each element of the action drives, by what it does to the simulation."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
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
    from transferkit.spec import Feedback, Joint

SCALAR = (int(mujoco.mjtJoint.mjJNT_SLIDE), int(mujoco.mjtJoint.mjJNT_HINGE))
"""Joints of one degree of freedom."""

NEGLIGIBLE = 1e-6
"""Of the largest force on a degree of freedom."""

EVEN = 1e-3
"""Difference of controls, as a share of what an action changes, that counts as none."""

FAINT = 1e-2
"""Of the largest force that an action causes."""

WHOLE = 0.99
"""Share of a force from which it is not said to be clipped."""


def read_actuators(
    low: NDArray, high: NDArray, responses: Responses, model: mujoco.MjModel, joints: Sequence[Joint]
) -> list[Actuator]:
    """Describe each element of the action, with the bounds `(act_dim,)` that the environment states."""
    rows = zip(low, high, responses.looks, strict=True)
    found = [_actuator(k, float(a), float(b), responses, looks, model, joints) for k, (a, b, looks) in enumerate(rows)]
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
    responses: Responses,
    looks: Sequence[tuple[float, Look]],
    model: mujoco.MjModel,
    joints: Sequence[Joint],
) -> Actuator:
    none = responses.none
    driven = np.flatnonzero(np.any([look.control != none.control for _, look in looks], axis=0))
    model_name = "+".join(actuator_name(model, int(i)) for i in driven) or f"action{k}"
    dof = _only_dof(looks, none, driven, model)
    feedback = _feedback(responses, looks)
    told = [
        one.control[driven] if len(driven) else one.force[[] if dof is None else [dof]]
        for one in (looks[0][1], looks[1][1], none)
    ]
    rest = 0.0 if feedback else _rest(low, high, looks[0][0], told)
    if dof is None:
        return replace(_unknown(k, low, high), name=model_name, model_name=model_name, rest=rest, feedback=feedback)
    joint, half_range = joints[dof], (high - low) / 2
    forces = [(share, float(look.force[dof] - none.force[dof])) for share, look in looks]
    gear = float(f"{_steepest(forces) / half_range:.6g}") + 0.0
    acceleration = _steepest([(share, look.acceleration[dof] - none.acceleration[dof]) for share, look in looks])
    return Actuator(
        DRIVE + joint.name,
        model_name,
        joint.name,
        low,
        high,
        gear,
        round(acceleration, digits_of(abs(acceleration))) + 0.0,
        "N" if joint.type == "slide" else "N m",
        rest,
        feedback,
        _clipped(dict(forces), gear * half_range, gear * ((low + high) / 2 - rest)),
    )


def _rest(low: float, high: float, share: float, told: Sequence[NDArray]) -> float:
    """The action at which all that it changes is zero; 0 if there is none, or it cannot be told.

    `told` is that with an action of this share, of minus this share, and of zero. It cannot be told where a small action
    changes something by another amount one way than the other.
    """
    up, down, none = told
    change, uneven = up - down, up + down - 2 * none
    if not len(none) or not change.all() or (np.abs(uneven) > EVEN * np.abs(change)).any():
        return 0.0
    actions = -none * 2 * share / change
    at = (low + high) / 2 + (high - low) / 2 * float(actions[0])
    return float(f"{at:.6g}") + 0.0 if np.ptp(actions) < EVEN and abs(at) > EVEN * (high - low) else 0.0


def _feedback(responses: Responses, looks: Sequence[tuple[float, Look]]) -> Feedback:
    """What the force of an action depends on besides it, if that changes it by more than next to nothing."""
    still = responses.none.force
    caused = np.max([np.abs(look.force - still) for _, look in looks], axis=0)
    least = np.where(caused > NEGLIGIBLE * caused.max(initial=0.0), FAINT * caused, np.inf)
    if (np.abs(responses.moved.force - still) > least).any():
        return "position"
    return "velocity" if (np.abs(responses.moving.force - still) > least).any() else ""


def _clipped(forces: Mapping[float, float], promised: float, offset: float) -> tuple[float, float] | None:
    """What there is at either end of the action, where either has less than its slope promises."""
    ends = forces[-1.0], forces[1.0]
    if not promised or min(-ends[0] / promised, ends[1] / promised) > WHOLE:
        return None
    low, high = (float(f"{end + offset:.6g}") + 0.0 for end in ends)
    return low, high


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
