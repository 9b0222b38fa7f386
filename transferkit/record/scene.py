"""A MuJoCo model's geoms as Foxglove's scene: one entity a body, in the body's own frame, which transforms move."""

from __future__ import annotations

from collections import defaultdict
from collections.abc import Iterator, Sequence
from typing import Any

import numpy as np
from foxglove.messages import (
    Color,
    CubePrimitive,
    CylinderPrimitive,
    FrameTransform,
    FrameTransforms,
    Point3,
    Pose,
    Quaternion,
    SceneEntity,
    SceneUpdate,
    SpherePrimitive,
    Timestamp,
    TriangleListPrimitive,
    Vector3,
)
from numpy.typing import NDArray

from transferkit.physics import mujoco
from transferkit.record.state import FULL_STATE

WORLD = "world"
PLANE_SIZE, PLANE_THICKNESS = 20.0, 0.01
"""Metres; of a plane without bounds, which MuJoCo draws to the horizon."""

Geom = mujoco.mjtGeom


def scene(model: mujoco.MjModel, nanoseconds: int) -> SceneUpdate:
    """Draw every visible geom of the model; height fields and signed distance fields are left out."""
    return SceneUpdate(entities=[_entity(model, body, _time(nanoseconds)) for body in range(model.nbody)])


class Transforms:
    """Computes where every body is in the world, from states of the simulation."""

    def __init__(self, model: mujoco.MjModel) -> None:
        self._model, self._data = model, mujoco.MjData(model)  # poses in the simulation's own data may lag behind its state
        self._names = [_name(model, body) for body in range(1, model.nbody)]
        self._positions, self._quaternions = self._data.xpos[1:], self._data.xquat[1:]

    def at(self, state: NDArray[np.float64], nanoseconds: int) -> FrameTransforms:
        """Make the message for an integration state."""
        mujoco.mj_setState(self._model, self._data, state, FULL_STATE)
        mujoco.mj_kinematics(self._model, self._data)
        stamp = _time(nanoseconds)
        poses = zip(self._names, self._positions.tolist(), self._quaternions.tolist(), strict=True)
        return FrameTransforms(transforms=[_transform(stamp, *pose) for pose in poses])


def _transform(stamp: Timestamp, name: str, position: list[float], quaternion: list[float]) -> FrameTransform:
    (x, y, z), (w, i, j, k) = position, quaternion
    return FrameTransform(
        timestamp=stamp,
        parent_frame_id=WORLD,
        child_frame_id=name,
        translation=Vector3(x=x, y=y, z=z),
        rotation=Quaternion(w=w, x=i, y=j, z=k),
    )


def _entity(model: mujoco.MjModel, body: int, stamp: Timestamp) -> SceneEntity:
    parts: Any = defaultdict(list)
    for geom in range(model.body_geomadr[body], model.body_geomadr[body] + model.body_geomnum[body]):
        if model.geom_rgba[geom, 3] > 0:
            for kind, primitive in _primitives(model, geom):
                parts[kind].append(primitive)
    name = _name(model, body)
    return SceneEntity(id=name, frame_id=name, frame_locked=True, timestamp=stamp, **parts)


def _primitives(model: mujoco.MjModel, geom: int) -> Iterator[tuple[str, Any]]:
    size, kind = model.geom_size[geom].tolist(), Geom(int(model.geom_type[geom]))
    look = {"pose": _pose(model.geom_pos[geom], model.geom_quat[geom]), "color": _colour(model, geom)}
    if kind == Geom.mjGEOM_SPHERE:
        yield "spheres", SpherePrimitive(size=_vector([2 * size[0]] * 3), **look)
    elif kind == Geom.mjGEOM_ELLIPSOID:
        yield "spheres", SpherePrimitive(size=_vector([2 * s for s in size]), **look)
    elif kind == Geom.mjGEOM_BOX:
        yield "cubes", CubePrimitive(size=_vector([2 * s for s in size]), **look)
    elif kind == Geom.mjGEOM_PLANE:
        sides = [2 * s if s else PLANE_SIZE for s in size[:2]]
        yield "cubes", CubePrimitive(size=_vector([*sides, PLANE_THICKNESS]), **look)
    elif kind in (Geom.mjGEOM_CYLINDER, Geom.mjGEOM_CAPSULE):
        extent = _vector([2 * size[0], 2 * size[0], 2 * size[1]])
        yield "cylinders", CylinderPrimitive(size=extent, bottom_scale=1.0, top_scale=1.0, **look)
        if kind == Geom.mjGEOM_CAPSULE:
            yield from _caps(model, geom, size)
    elif kind == Geom.mjGEOM_MESH:
        yield "triangles", _mesh(model, model.geom_dataid[geom], look)


def _caps(model: mujoco.MjModel, geom: int, size: list[float]) -> Iterator[tuple[str, Any]]:
    axis = np.zeros(3)
    mujoco.mju_rotVecQuat(axis, np.array([0.0, 0.0, size[1]]), model.geom_quat[geom])
    for end in (model.geom_pos[geom] + axis, model.geom_pos[geom] - axis):
        pose = _pose(end.tolist(), model.geom_quat[geom])
        yield "spheres", SpherePrimitive(size=_vector([2 * size[0]] * 3), pose=pose, color=_colour(model, geom))


def _mesh(model: mujoco.MjModel, mesh: int, look: dict[str, Any]) -> TriangleListPrimitive:
    first, count = model.mesh_vertadr[mesh], model.mesh_vertnum[mesh]
    points = [Point3(x=x, y=y, z=z) for x, y, z in model.mesh_vert[first : first + count].tolist()]
    first, count = model.mesh_faceadr[mesh], model.mesh_facenum[mesh]
    return TriangleListPrimitive(points=points, indices=model.mesh_face[first : first + count].ravel().tolist(), **look)


def _name(model: mujoco.MjModel, body: int) -> str:
    return WORLD if body == 0 else model.body(body).name or f"body {body}"


def _colour(model: mujoco.MjModel, geom: int) -> Color:
    material = model.geom_matid[geom]
    r, g, b, a = (model.geom_rgba[geom] if material < 0 else model.mat_rgba[material]).tolist()
    return Color(r=r, g=g, b=b, a=a)


def _pose(position: Sequence[float], quaternion: Sequence[float]) -> Pose:
    return Pose(position=_vector(position), orientation=_quaternion(quaternion))


def _vector(xyz: Sequence[float]) -> Vector3:
    return Vector3(x=float(xyz[0]), y=float(xyz[1]), z=float(xyz[2]))


def _quaternion(wxyz: Sequence[float]) -> Quaternion:
    return Quaternion(w=float(wxyz[0]), x=float(wxyz[1]), y=float(wxyz[2]), z=float(wxyz[3]))


def _time(nanoseconds: int) -> Timestamp:
    return Timestamp(*divmod(nanoseconds, 10**9))
