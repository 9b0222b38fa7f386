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

_, BALL, SLIDE, HINGE = range(4)  # of `mujoco.mjtJoint`
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
        rest = data.subtree_com[body] - data.xanchor[j]
        for type_, axis in _degrees_of_freedom(int(model.jnt_type[j]), data.xaxis[j], data.xmat[body].reshape(3, 3)):
            name = _canonical_name(type_, axis, used)
            length = float(np.linalg.norm(rest)) if type_ == "hinge" else 0.0
            direction = rest / length if length > 1e-6 else np.zeros(3)
            model_name = model.joint(j).name or f"joint{j}"
            joints.append(Joint(name, model_name, type_, _rounded(axis), parent, _rounded(direction), round(length, 6)))
            last_of_body[body] = parent = name
    return joints


def _parent(model: mujoco.MjModel, body: int, last_of_body: dict[int, str]) -> str | None:
    while body > 0:
        if body in last_of_body:
            return last_of_body[body]
        body = int(model.body_parentid[body])
    return None


def _degrees_of_freedom(type_: int, axis: NDArray, frame: NDArray) -> list[tuple[JointType, NDArray]]:
    if type_ == SLIDE:
        return [("slide", axis)]
    if type_ == HINGE:
        return [("hinge", axis)]
    slides: list[tuple[JointType, NDArray]] = [("slide", np.eye(3)[k]) for k in range(3)]
    # MuJoCo's angular velocities are in the body frame.
    rotations: list[tuple[JointType, NDArray]] = [("hinge", frame[:, k]) for k in range(3)]
    return rotations if type_ == BALL else slides + rotations


def _canonical_name(type_: str, axis: NDArray, used: Counter[str]) -> str:
    k = int(np.argmax(np.abs(axis)))
    name = f"{type_}_{AXES[k]}" if abs(axis[k]) > 0.99 else f"{type_}_oblique"
    used[name] += 1
    return name if used[name] == 1 else f"{name}{used[name]}"


def _rounded(vector: NDArray) -> tuple[float, float, float]:
    x, y, z = (round(float(value), 6) + 0.0 for value in vector)
    return x, y, z
