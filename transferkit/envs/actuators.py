"""What each element of the action drives, by what it does to the simulation."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from transferkit.envs.forms import digits_of
from transferkit.envs.labels import unique
from transferkit.envs.responses import EVEN, NEGLIGIBLE
from transferkit.physics import mujoco
from transferkit.spec import DRIVE, Actuator

if TYPE_CHECKING:
    from transferkit.envs.responses import Responses
    from transferkit.spec import Feedback, Joint

SCALAR = (int(mujoco.mjtJoint.mjJNT_SLIDE), int(mujoco.mjtJoint.mjJNT_HINGE))
"""Joints of one degree of freedom."""

FAINT = 1e-4
"""Change of a force, as a share of the largest that its action causes, that counts as none."""

WHOLE = 0.99
"""Share of a force from which it is not said to be clipped."""


def read_actuators(
    low: NDArray, high: NDArray, responses: Responses, model: mujoco.MjModel, joints: Sequence[Joint]
) -> list[Actuator]:
    """Describe each element of the action, with the bounds `(act_dim,)` that the environment states."""
    rows = enumerate(zip(low, high, strict=True))
    found = [_actuator(k, float(a), float(b), responses, model, joints) for k, (a, b) in rows]
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
    model: mujoco.MjModel,
    joints: Sequence[Joint],
) -> Actuator:
    driven = responses.drives(k)
    model_name = "+".join(actuator_name(model, int(i)) for i in driven) or f"action{k}"
    dof, feedback = _only_dof(responses.pushes(k), driven, model), _feedback(k, responses)
    resting = responses.rest[k]
    rest = None if resting is None else _rounded((low + high) / 2 + (high - low) / 2 * resting[0], high - low)
    if responses.adds_up(k):
        return replace(_unknown(k, low, high), name=model_name, model_name=model_name)
    if dof is None:
        return replace(_unknown(k, low, high), name=model_name, model_name=model_name, rest=rest, feedback=feedback)
    none, looks = responses.none, responses.looks[k]
    joint, half_range = joints[dof], (high - low) / 2
    forces = [(share, float(look.force[dof] - none.force[dof])) for share, look in looks]
    slope, stiffness = _steepest(forces), _stiffness(driven, model) if feedback == "position" else 0.0
    if stiffness:  # a servo may be clipped at any distance that is worth a look
        told = _steepest([(share, float(look.control[driven[0]] - none.control[driven[0]])) for share, look in looks])
        slope = told * float(model.actuator_gainprm[driven[0], 0] * model.actuator_gear[driven[0], 0])
    gear = float(f"{slope / half_range:.6g}") + 0.0
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
        stiffness,
        _clipped(dict(forces), gear * half_range, resting and (resting[0], float(resting[1].force[dof] - none.force[dof]))),
    )


def _rounded(rest: float, width: float) -> float:
    return float(f"{rest:.6g}") + 0.0 if abs(rest) > EVEN * width else 0.0


def _feedback(k: int, responses: Responses) -> Feedback:
    """What the force of an action depends on besides it."""
    none, noise = responses.effect(k, responses.none), responses.effect(k, responses.noise)
    caused = np.max([np.abs(responses.effect(k, look) - none) for _, look in responses.looks[k]], axis=0, initial=0.0)
    least = np.where(caused > NEGLIGIBLE * caused.max(initial=0.0), FAINT * caused + noise, np.inf)
    kinds: tuple[Feedback, Feedback] = ("position", "velocity")
    for one, kind in enumerate(kinds):
        changes = [responses.effect(k, looks[1 + one]) - responses.effect(k, looks[0]) for looks in responses.elsewhere]
        if any((np.abs(change) > least).any() for change in changes):
            return kind
    return ""


def _stiffness(driven: NDArray[np.intp], model: mujoco.MjModel) -> float:
    """By how much the force of a joint's position servo falls as the joint moves; 0 of everything else."""
    if len(driven) != 1 or model.actuator_biastype[driven[0]] != int(mujoco.mjtBias.mjBIAS_AFFINE):
        return 0.0
    kp, gear = -float(model.actuator_biasprm[driven[0], 1]), float(model.actuator_gear[driven[0], 0])
    return max(0.0, kp) * gear**2


def _clipped(forces: Mapping[float, float], promised: float, rest: tuple[float, float] | None) -> tuple[float, float] | None:
    """What there is at either end of the action, where either has less than its slope promises."""
    ends = forces[-1.0], forces[1.0]
    shares = -ends[0] / promised if promised else 1.0, ends[1] / promised if promised else 1.0
    if min(shares) > WHOLE or (max(shares) > WHOLE and min(shares) < -WHOLE):  # a square pushes one way at both ends
        return None
    share, none = rest or (0.0, 0.0)
    none = none if abs(share) <= 1 else promised * share
    low, high = (float(f"{end - none:.6g}") + 0.0 for end in ends)
    return low, high


def _only_dof(forces: NDArray[np.float64], driven: NDArray[np.intp], model: mujoco.MjModel) -> int | None:
    """The one degree of freedom that an action pushes, or the one that its actuator is on."""
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
