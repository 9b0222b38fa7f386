"""A MuJoCo model's geoms as Foxglove's scene: one entity a body, in the body's own frame, which transforms move."""

# pyright: reportAttributeAccessIssue=false
# mujoco's and protobuf's names come from compiled modules that pyright cannot read.
from __future__ import annotations

from typing import Any

import mujoco
import numpy as np
from foxglove_schemas_protobuf.Color_pb2 import Color
from foxglove_schemas_protobuf.CubePrimitive_pb2 import CubePrimitive
from foxglove_schemas_protobuf.CylinderPrimitive_pb2 import CylinderPrimitive
from foxglove_schemas_protobuf.FrameTransform_pb2 import FrameTransform
from foxglove_schemas_protobuf.FrameTransforms_pb2 import FrameTransforms
from foxglove_schemas_protobuf.Point3_pb2 import Point3
from foxglove_schemas_protobuf.Pose_pb2 import Pose
from foxglove_schemas_protobuf.Quaternion_pb2 import Quaternion
from foxglove_schemas_protobuf.SceneEntity_pb2 import SceneEntity
from foxglove_schemas_protobuf.SceneUpdate_pb2 import SceneUpdate
from foxglove_schemas_protobuf.SpherePrimitive_pb2 import SpherePrimitive
from foxglove_schemas_protobuf.TriangleListPrimitive_pb2 import TriangleListPrimitive
from foxglove_schemas_protobuf.Vector3_pb2 import Vector3
from google.protobuf.timestamp_pb2 import Timestamp

WORLD = "world"
PLANE_SIZE, PLANE_THICKNESS = 20.0, 0.01
"""Metres; of a plane without bounds, which MuJoCo draws to the horizon."""

Geom = mujoco.mjtGeom


def scene(model: Any, nanoseconds: int) -> SceneUpdate:  # noqa: ANN401 - mujoco.MjModel
    """Every visible geom of the model; height fields and signed distance fields are left out."""
    entities = []
    for body in range(model.nbody):
        entity = SceneEntity(
            id=_name(model, body), frame_id=_name(model, body), frame_locked=True, timestamp=_time(nanoseconds)
        )
        for geom in range(model.body_geomadr[body], model.body_geomadr[body] + model.body_geomnum[body]):
            if model.geom_rgba[geom, 3] > 0:
                _add(entity, model, geom)
        entities.append(entity)
    return SceneUpdate(entities=entities)


class Transforms:
    """Where every body of a model is in the world; one message that is filled again for every moment."""

    def __init__(self, model: Any) -> None:  # noqa: ANN401 - mujoco.MjModel
        frames = [
            FrameTransform(
                timestamp=Timestamp(),
                parent_frame_id=WORLD,
                child_frame_id=_name(model, body),
                translation=Vector3(),
                rotation=Quaternion(),
            )
            for body in range(1, model.nbody)
        ]
        self._message = FrameTransforms(transforms=frames)
        self._parts = [(frame.timestamp, frame.translation, frame.rotation) for frame in self._message.transforms]

    def at(self, data: Any, nanoseconds: int) -> FrameTransforms:  # noqa: ANN401 - mujoco.MjData
        """The message for the present state of the simulation."""
        seconds, nanos = divmod(nanoseconds, 10**9)
        poses = zip(self._parts, data.xpos[1:].tolist(), data.xquat[1:].tolist(), strict=True)
        for (stamp, translation, rotation), position, quaternion in poses:
            stamp.seconds, stamp.nanos = seconds, nanos
            translation.x, translation.y, translation.z = position
            rotation.w, rotation.x, rotation.y, rotation.z = quaternion
        return self._message


def _add(entity: SceneEntity, model: Any, geom: int) -> None:  # noqa: ANN401
    size, kind = model.geom_size[geom].tolist(), Geom(int(model.geom_type[geom]))
    look = {"pose": _pose(model.geom_pos[geom], model.geom_quat[geom]), "color": _colour(model, geom)}
    if kind == Geom.mjGEOM_SPHERE:
        entity.spheres.append(SpherePrimitive(size=_vector([2 * size[0]] * 3), **look))
    elif kind == Geom.mjGEOM_ELLIPSOID:
        entity.spheres.append(SpherePrimitive(size=_vector([2 * s for s in size]), **look))
    elif kind == Geom.mjGEOM_BOX:
        entity.cubes.append(CubePrimitive(size=_vector([2 * s for s in size]), **look))
    elif kind == Geom.mjGEOM_PLANE:
        sides = [2 * s if s else PLANE_SIZE for s in size[:2]]
        entity.cubes.append(CubePrimitive(size=_vector([*sides, PLANE_THICKNESS]), **look))
    elif kind in (Geom.mjGEOM_CYLINDER, Geom.mjGEOM_CAPSULE):
        cylinder = CylinderPrimitive(size=_vector([2 * size[0], 2 * size[0], 2 * size[1]]), bottom_scale=1, top_scale=1, **look)
        entity.cylinders.append(cylinder)
        if kind == Geom.mjGEOM_CAPSULE:
            _add_caps(entity, model, geom, size)
    elif kind == Geom.mjGEOM_MESH:
        entity.triangles.append(_mesh(model, model.geom_dataid[geom], look))


def _add_caps(entity: SceneEntity, model: Any, geom: int, size: list[float]) -> None:  # noqa: ANN401
    axis = np.zeros(3)
    mujoco.mju_rotVecQuat(axis, np.array([0.0, 0.0, size[1]]), model.geom_quat[geom])
    for end in (model.geom_pos[geom] + axis, model.geom_pos[geom] - axis):
        pose = _pose(end, model.geom_quat[geom])
        entity.spheres.append(SpherePrimitive(size=_vector([2 * size[0]] * 3), pose=pose, color=_colour(model, geom)))


def _mesh(model: Any, mesh: int, look: dict[str, Any]) -> TriangleListPrimitive:  # noqa: ANN401
    first, count = model.mesh_vertadr[mesh], model.mesh_vertnum[mesh]
    points = [Point3(x=x, y=y, z=z) for x, y, z in model.mesh_vert[first : first + count].tolist()]
    first, count = model.mesh_faceadr[mesh], model.mesh_facenum[mesh]
    return TriangleListPrimitive(points=points, indices=model.mesh_face[first : first + count].ravel().tolist(), **look)


def _name(model: Any, body: int) -> str:  # noqa: ANN401
    return WORLD if body == 0 else model.body(body).name or f"body {body}"


def _colour(model: Any, geom: int) -> Color:  # noqa: ANN401
    material = model.geom_matid[geom]
    r, g, b, a = (model.geom_rgba[geom] if material < 0 else model.mat_rgba[material]).tolist()
    return Color(r=r, g=g, b=b, a=a)


def _pose(position: Any, quaternion: Any) -> Pose:  # noqa: ANN401 - arrays
    return Pose(position=_vector(position), orientation=_quaternion(quaternion))


def _vector(xyz: Any) -> Vector3:  # noqa: ANN401
    return Vector3(x=float(xyz[0]), y=float(xyz[1]), z=float(xyz[2]))


def _quaternion(wxyz: Any) -> Quaternion:  # noqa: ANN401 - MuJoCo's order
    return Quaternion(w=float(wxyz[0]), x=float(wxyz[1]), y=float(wxyz[2]), z=float(wxyz[3]))


def _time(nanoseconds: int) -> Timestamp:
    return Timestamp(seconds=nanoseconds // 10**9, nanos=nanoseconds % 10**9)
