"""Changes of a MuJoCo model before it is compiled: what somebody would change in its XML."""

from __future__ import annotations

import warnings
from collections.abc import Callable, Iterable, Mapping, Sequence
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from transferkit.errors import ConfigError, UnknownNameError, reason_of
from transferkit.physics import mujoco
from transferkit.variation import FACTORS

if TYPE_CHECKING:
    from transferkit.variation import Place

Geom = mujoco.mjtGeom
ROUND, LONG = (Geom.mjGEOM_SPHERE, Geom.mjGEOM_PLANE), (Geom.mjGEOM_CAPSULE, Geom.mjGEOM_CYLINDER)
BLOCKS = (Geom.mjGEOM_BOX, Geom.mjGEOM_ELLIPSOID)

Factors = Mapping[str, Mapping[str, float]]
"""By property and part; the part `` stands for all of them."""


def edited(spec: mujoco.MjSpec, factors: Factors, dead: Sequence[Place]) -> mujoco.MjModel:
    """Compile a changed copy of a model.

    Raises:
        UnknownNameError: the model has no such part.
        ConfigError: the change cannot be made on it.
    """
    copy = spec.copy()
    _check_once(copy, factors.get("gear", {}))
    for name, table in factors.items():
        for part, factor in table.items():
            EDITS[name](copy, part, factor)
    for actuator in _dead(copy, dead):
        actuator.gear = np.zeros(6)
    try:
        return compiled(copy)
    except ValueError as error:
        raise ConfigError(f"the varied model does not compile: {reason_of(error)}", topic="variations") from None


def compiled(spec: mujoco.MjSpec) -> mujoco.MjModel:
    """Compile a model without words about what is deprecated in somebody's XML."""
    with warnings.catch_warnings(action="ignore"):
        return spec.compile()


def _mass(spec: mujoco.MjSpec, part: str, factor: float) -> None:
    if spec.compiler.settotalmass > 0:
        if part:
            raise ConfigError("the model fixes its total mass, so no single body can be heavier", topic="variations")
        spec.compiler.settotalmass *= factor
        return
    for body in _parts("mass", part, spec.bodies[1:]):
        for geom in body.geoms:
            if np.isnan(geom.mass):
                geom.density *= factor
            else:
                geom.mass *= factor
        body.mass *= factor
        body.inertia = body.inertia * factor
        body.fullinertia = body.fullinertia * factor


def _length(spec: mujoco.MjSpec, part: str, factor: float) -> None:
    """Stretch bodies away from their own joint; what hangs on them moves along, and keeps its size."""
    before = compiled(spec)
    for body in _parts("length", part, spec.bodies[1:]):
        if body.explicitinertial:
            raise ConfigError(f"length of body {body.name}: its inertia is given in numbers", topic="variations")
        anchor = _joint_of(body)
        for geom in body.geoms:
            _stretch(geom, anchor, factor)
        for site in body.sites:
            site.pos = anchor + factor * (site.pos - anchor)
        for child in body.bodies:
            at = child.pos + _rotation(before, child) @ _joint_of(child)
            child.pos = child.pos + (factor - 1) * (at - anchor)


def _stretch(geom: Any, anchor: NDArray[np.float64], factor: float) -> None:  # noqa: ANN401 - MjsGeom
    sizes = geom.size.copy()
    if geom.type in LONG:
        sizes[1] *= factor
    elif geom.type in BLOCKS:
        sizes[int(np.argmax(sizes))] *= factor
    elif geom.type not in ROUND:
        raise ConfigError(f"length of geom {geom.name or 'without a name'}: it is a mesh or a height field", topic="variations")
    if not np.isnan(geom.fromto[0]):
        ends = geom.fromto.reshape(2, 3)
        geom.fromto = (anchor + factor * (ends - anchor)).ravel()
    else:
        geom.size, geom.pos = sizes, anchor + factor * (geom.pos - anchor)


def _gear(spec: mujoco.MjSpec, part: str, factor: float) -> None:
    for actuator in _actuators(spec, part):
        actuator.gear = actuator.gear * factor


def _actuators(spec: mujoco.MjSpec, part: str) -> list[Any]:
    """All actuators, or those of a name or on a joint; one without a name is called by its number, as in `envs show`."""
    return _parts("gear", part, spec.actuators, lambda one: (one.name or f"actuator{one.id}", one.target))


def _check_once(spec: mujoco.MjSpec, gears: Mapping[str, float]) -> None:
    """Refuse factors for an actuator and for the joint that it is on."""
    named: dict[int, str] = {}
    for part in filter(None, gears):
        for actuator in _actuators(spec, part):
            if (other := named.setdefault(actuator.id, part)) != part:
                raise ConfigError(f"gear has {other} and {part}, which are one", remedy="leave one out", topic="variations")


def _damping(spec: mujoco.MjSpec, part: str, factor: float) -> None:
    for joint in _parts("damping", part, spec.joints):
        joint.damping = joint.damping * factor


def _friction(spec: mujoco.MjSpec, part: str, factor: float) -> None:
    """Sliding friction; torsional and rolling friction stay."""
    for geom in _parts("friction", part, spec.geoms):
        geom.friction = geom.friction * (factor, 1.0, 1.0)
    for pair in spec.pairs:
        if not part or part in (pair.geomname1, pair.geomname2):
            pair.friction = pair.friction * (factor, factor, 1.0, 1.0, 1.0)


def _gravity(spec: mujoco.MjSpec, part: str, factor: float) -> None:
    del part
    spec.option.gravity = spec.option.gravity * factor


EDITS: Mapping[str, Callable[[mujoco.MjSpec, str, float], None]] = {
    "mass": _mass,
    "length": _length,
    "gear": _gear,
    "damping": _damping,
    "friction": _friction,
    "gravity": _gravity,
}


def _parts(
    what: str, part: str, among: Iterable[Any], names: Callable[[Any], Sequence[str]] = lambda one: (one.name,)
) -> list[Any]:
    """All parts of a kind, or those of a name."""
    among = list(among)
    chosen = [one for one in among if not part or part in names(one)]
    if not chosen and part:
        raise UnknownNameError(FACTORS[what], part, [name for one in among for name in names(one) if name], topic="variations")
    return chosen


def _dead(spec: mujoco.MjSpec, places: Sequence[Place]) -> list[Any]:
    chosen = []
    for place in places:
        if isinstance(place, int):
            if not 0 <= place < len(spec.actuators):
                raise ConfigError("dead_actuator", value=place, allowed=f"0 to {len(spec.actuators) - 1}", topic="variations")
            chosen.append(spec.actuators[place])
        else:
            chosen += _actuators(spec, place)
    return chosen


def _joint_of(body: Any) -> NDArray[np.float64]:  # noqa: ANN401 - MjsBody
    """Where a body is joined to its parent, in its own frame."""
    turning = (mujoco.mjtJoint.mjJNT_HINGE, mujoco.mjtJoint.mjJNT_BALL)
    anchors = [joint.pos for joint in body.joints if joint.type in turning]
    return np.array(anchors[-1]) if anchors else np.zeros(3)


def _rotation(model: mujoco.MjModel, body: Any) -> NDArray[np.float64]:  # noqa: ANN401 - MjsBody
    matrix = np.empty(9)
    mujoco.mju_quat2Mat(matrix, model.body_quat[body.id])
    return matrix.reshape(3, 3)
