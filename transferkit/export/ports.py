"""An observation as functions of what a robot measures: joint positions, joint velocities, and what neither explains."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

if TYPE_CHECKING:
    from transferkit.spec import Element, IOSpec

OF_POSITION, OF_VELOCITY = ("position", "sin", "cos"), ("velocity",)


@dataclass(frozen=True)
class Ports:
    """What is measured at a step, in this order, and how an observation is made of it.

    With `h` all that is measured, now and in earlier steps, and then earlier actions, each from the newest on, an element is
    `linear @ h + offset`, or sine or cosine of `angle @ h + offset`.
    """

    positions: tuple[str, ...]
    """Names of joints in their model."""
    velocities: tuple[str, ...]
    others: tuple[str, ...]
    """Names of elements that are measured as they are."""
    past: int
    """Earlier steps that are remembered."""
    past_actions: int
    """Earlier actions that are remembered."""
    linear: NDArray[np.float32]
    """`(obs_dim, h)`."""
    offset: NDArray[np.float32]
    """`(obs_dim,)`."""
    angle: NDArray[np.float32]
    """`(obs_dim, h)`."""
    form: NDArray[np.float32]
    """`(3, obs_dim)`: 1 where an element is linear, a sine, a cosine."""

    @property
    def measured(self) -> int:
        """Numbers that are measured at a step."""
        return len(self.positions) + len(self.velocities) + len(self.others)


def ports_of(spec: IOSpec) -> Ports:
    """Find what has to be measured for the observations of a spec."""
    names = spec.model_names
    used = {kinds: _joints(spec, kinds) for kinds in (OF_POSITION, OF_VELOCITY)}
    others = dict.fromkeys(one.name_now for one in spec.observation if _source(one) is None and one.quantity != "action")
    measured = [*((kind, name) for kind, joints in used.items() for name in joints), *((None, name) for name in others)]
    past = max((one.age for one in spec.observation if one.quantity != "action"), default=0)
    actions = max((one.age + 1 for one in spec.observation if one.quantity == "action"), default=0)
    width = len(measured) * (past + 1) + spec.act_dim * actions
    linear, angle = (np.zeros((spec.obs_dim, width), np.float32) for _ in range(2))
    offset, form = np.zeros(spec.obs_dim, np.float32), np.zeros((3, spec.obs_dim), np.float32)
    for k, element in enumerate(spec.observation):
        turned = element.quantity in ("sin", "cos")
        form[("sin", "cos").index(element.quantity) + 1 if turned else 0, k] = 1.0
        offset[k] = element.offset
        for column, coefficient in _columns(element, spec, measured, past):
            (angle if turned else linear)[k, column] = coefficient
    positions, velocities = (tuple(names[name] for name in joints) for joints in used.values())
    return Ports(positions, velocities, tuple(others), past, actions, linear, offset, angle, form)


def _source(element: Element) -> tuple[str, ...] | None:
    """Which measurement an element is a function of."""
    return next((kinds for kinds in (OF_POSITION, OF_VELOCITY) if element.quantity in kinds), None)


def _joints(spec: IOSpec, kinds: tuple[str, ...]) -> list[str]:
    """Joints that elements of these kinds depend on, in the order of the model."""
    needed = {name for element in spec.observation if element.quantity in kinds for name in element.joints}
    return [joint.name for joint in spec.joints if joint.name in needed]


def _columns(element: Element, spec: IOSpec, measured: Sequence[tuple[object, str]], past: int) -> list[tuple[int, float]]:
    """Where what an element is made of stands in `h`, and its coefficients."""
    if element.quantity == "action":
        names = [actuator.acted for actuator in spec.action]
        first = len(measured) * (past + 1) + spec.act_dim * element.age
        return [(first + names.index(element.name_now), 1.0)]
    first, kinds = len(measured) * element.age, _source(element)
    if kinds is not None:
        joints = zip(element.joints, element.coefficients, strict=True)
        return [(first + measured.index((kinds, name)), value) for name, value in joints]
    return [(first + measured.index((None, element.name_now)), 1.0)]
