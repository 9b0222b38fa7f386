"""The joints of a MuJoCo model, with names that do not depend on who wrote the model."""

from __future__ import annotations

from collections import Counter
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from transferkit.physics import mujoco
from transferkit.spec import Joint

if TYPE_CHECKING:
    from transferkit.spec import JointType

FREE, BALL, SLIDE, HINGE = range(4)  # of `mujoco.mjtJoint`
AXES = "xyz"


def read_joints(model: mujoco.MjModel) -> list[Joint]:
    """Read one `Joint` per degree of freedom, at the reference pose, in the order of `qvel`."""
    data = mujoco.MjData(model)
    mujoco.mj_forward(model, data)
    joints: list[Joint] = []
    last_of_body: dict[int, str] = {}
    used: Counter[str] = Counter()
    for j in range(model.njnt):
        body = int(model.jnt_bodyid[j])
        parent = _parent(model, body, last_of_body)
        for k, (type_, axis) in enumerate(_degrees_of_freedom(model, data, j)):
            name = _canonical_name(type_, axis, used)
            joints.append(_joint(model, data, j, name, type_, axis, parent, _reference(model, j, k)))
            last_of_body[body] = parent = name
    return joints


def _joint(
    model: mujoco.MjModel,
    data: mujoco.MjData,
    j: int,
    name: str,
    type_: JointType,
    axis: NDArray,
    parent: str | None,
    reference: float,
) -> Joint:
    body = int(model.jnt_bodyid[j])
    rest = data.subtree_com[body] - data.xanchor[j]
    if model.opt.gravity[2] > 0:  # what is above then hangs
        rest = rest * (1.0, 1.0, -1.0)
    length = float(np.linalg.norm(rest)) if type_ == "hinge" else 0.0
    return Joint(
        name=name,
        model_name=model.joint(j).name or f"joint{j}",
        type=type_,
        axis=_rounded(axis),
        parent=parent,
        rest=_rounded(rest / length if length > 1e-6 else np.zeros(3)),
        length=round(length, 6),
        body=model.body(body).name or f"body{body}",
        anchor=_rounded(data.xanchor[j]),
        mass=round(float(model.body_subtreemass[body]), 6),
        range=_range(model, j),
        reference=reference,
    )


def _parent(model: mujoco.MjModel, body: int, last_of_body: dict[int, str]) -> str | None:
    while body > 0:
        if body in last_of_body:
            return last_of_body[body]
        body = int(model.body_parentid[body])
    return None


def _degrees_of_freedom(model: mujoco.MjModel, data: mujoco.MjData, j: int) -> list[tuple[JointType, NDArray]]:
    type_, axis = int(model.jnt_type[j]), data.xaxis[j]
    if type_ == SLIDE:
        return [("slide", axis)]
    if type_ == HINGE:
        return [("hinge", axis)]
    frame = data.xmat[model.jnt_bodyid[j]].reshape(3, 3)
    slides: list[tuple[JointType, NDArray]] = [("slide", np.eye(3)[k]) for k in range(3)]
    # MuJoCo's angular velocities are in the body frame.
    rotations: list[tuple[JointType, NDArray]] = [("hinge", frame[:, k]) for k in range(3)]
    return rotations if type_ == BALL else slides + rotations


def _range(model: mujoco.MjModel, j: int) -> tuple[float, float] | None:
    if model.jnt_type[j] not in (SLIDE, HINGE) or not model.jnt_limited[j]:
        return None
    low, high = model.jnt_range[j]
    return round(float(low), 6) + 0.0, round(float(high), 6) + 0.0


def _reference(model: mujoco.MjModel, j: int, k: int) -> float:
    """The position of degree of freedom k of a joint at the reference pose; rotations of free and ball joints have none."""
    address = int(model.jnt_qposadr[j])
    translates = model.jnt_type[j] in (SLIDE, HINGE) or (model.jnt_type[j] == FREE and k < 3)
    return round(float(model.qpos0[address + k]), 6) + 0.0 if translates else 0.0


def _canonical_name(type_: str, axis: NDArray, used: Counter[str]) -> str:
    k = int(np.argmax(np.abs(axis)))
    name = f"{type_}_{AXES[k]}" if abs(axis[k]) > 0.99 else f"{type_}_oblique"
    used[name] += 1
    return name if used[name] == 1 else f"{name}{used[name]}"


def _rounded(vector: NDArray) -> tuple[float, float, float]:
    x, y, z = (round(float(value), 6) + 0.0 for value in vector)
    return x, y, z
