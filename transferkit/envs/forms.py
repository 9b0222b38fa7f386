"""The form of an observation element: which signal of the physics it is, over all sampled states."""

from __future__ import annotations

import itertools
import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from transferkit.envs.memory import SAMPLES
from transferkit.spec import ACTED, Element

if TYPE_CHECKING:
    from transferkit.envs.evidence import Evidence, Samples
    from transferkit.physics import mujoco
    from transferkit.spec import Joint, Quantity

TOLERANCE = 2e-5
"""Largest misfit of a form, relative to the element's spread (observations are float32)."""

LARGEST_SUM = 5
"""Angles in a sum that are searched for signs."""

FEW = 4
"""States in which the value of what has no form is kept."""

Dofs = NDArray[np.intp]


@dataclass(frozen=True)
class Forms:
    """Names the elements of an observation by what they depend on and how."""

    joints: Mapping[int, Joint]
    """By degree of freedom."""
    evidence: Evidence
    samples: Samples
    height_names: Callable[[int], str]
    """Gives the name of a column of `samples.height`."""
    action_names: Sequence[str]
    half_range: NDArray[np.floating]
    """`(act_dim,)`: half of the range of the environment's own actions."""
    elusive: NDArray[np.bool_]
    """`(obs_dim,)`: it changes in an episode, or from one to the next."""

    def element(self, i: int, label: str) -> Element:
        """Describe element `i`; `label` is its name if no form fits."""
        evidence = self.evidence
        if evidence.memory.mixed[i]:
            return Element(label, "unknown", (), (), 0.0, "")
        if evidence.memory.time[i]:
            return Element(label, "time", (), (), 0.0, "")
        element = self._present(i, label)
        certain = abs(element.offset) > 4 * evidence.memory.doubt[i]
        return replace(element, age=int(evidence.memory.age[i]), offset=element.offset if certain else 0.0)

    def _present(self, i: int, label: str) -> Element:
        """Describe it without its age."""
        evidence = self.evidence
        positions, velocities = np.flatnonzero(evidence.positions[i]), np.flatnonzero(evidence.velocities[i])
        y, tolerance, form = (
            self.samples.observation[:, i],
            _tolerance(self.samples.observation[:, i], evidence.memory.noise[i]),
            None,
        )
        if len(positions) and not len(velocities):
            form = self._position_form(y, positions, tolerance)
        elif len(velocities) and not len(positions):
            form = self._linear("velocity", y, velocities, self.samples.velocity, tolerance)
        if form is not None:
            return form
        names = tuple(self.joints[int(dof)].name for dof in sorted({*positions, *velocities}))
        if not names and np.count_nonzero(evidence.actions[i]) == 1:
            k = int(np.flatnonzero(evidence.actions[i])[0])
            if np.isclose(evidence.actions[i, k], self.half_range[k], rtol=1e-4):
                return Element(self.action_names[k] + ACTED, "action", (), (), 0.0, "")
        if evidence.controls[i] or (not names and evidence.motion[i]):
            return Element(label, "force", names, (), 0.0, "")
        if not names:
            return Element(label, "unknown" if self.elusive[i] else "constant", (), (), 0.0, "")
        quantity: Quantity = "function of velocity" if len(velocities) else "function of position"
        seen, doubt = self.samples.observation[:FEW, i], float(f"{4 * evidence.memory.doubt[i]:.2g}")
        values = tuple(float(f"{value:.5g}") + 0.0 for value in seen) if np.ptp(seen) > 2 * doubt else ()
        return Element(label, quantity, names, (), 0.0, "", values=values, doubt=doubt if values else 0.0)

    def _position_form(self, y: NDArray, dofs: Dofs, tolerance: float) -> Element | None:
        position, height = self.samples.position, _matching_column(y, self.samples.height, tolerance)
        form = self._linear("position", y, dofs, position, tolerance)
        if form is not None and not (height is not None and len(dofs) > 1):
            return form
        hinges_only = all(self.joints[int(dof)].type == "hinge" for dof in dofs)
        if hinges_only and len(dofs) <= LARGEST_SUM and np.isfinite(position[:, dofs]).all():
            for signs in itertools.product((1.0, -1.0), repeat=len(dofs) - 1):
                coefficients = np.array((1.0, *signs))
                form = self._trigonometric(y, dofs, coefficients, position[:, dofs] @ coefficients, tolerance)
                if form is not None:
                    return form
        if height is not None:
            names = tuple(self.joints[int(dof)].name for dof in dofs)
            return Element(f"{self.height_names(height)}.height", "height", names, (), 0.0, "m")
        return None

    def _linear(self, quantity: Quantity, y: NDArray, dofs: Dofs, signal: NDArray, tolerance: float) -> Element | None:
        columns = signal[:, dofs]
        if not np.isfinite(columns).all() or 2 * len(dofs) >= SAMPLES:
            return None
        fit = _least_squares(np.column_stack([columns, np.ones(SAMPLES)]), y, tolerance)
        if fit is None or not np.round(fit[:-1], 4).any():
            return None
        unit = "m" if self.joints[int(dofs[0])].type == "slide" else "rad"
        unit = unit if len({self.joints[int(dof)].type for dof in dofs}) == 1 else ""
        suffix = "/s" if quantity == "velocity" and unit else ""
        return self._named(quantity, dofs, fit[:-1], float(fit[-1]), unit + suffix)

    def _trigonometric(self, y: NDArray, dofs: Dofs, coefficients: NDArray, angle: NDArray, tolerance: float) -> Element | None:
        fit = _least_squares(np.column_stack([np.sin(angle), np.cos(angle), np.ones(SAMPLES)]), y, tolerance)
        if fit is None or abs(fit[2]) > 1e-3 or abs(np.hypot(fit[0], fit[1]) - 1) > 1e-3:
            return None
        # a sin x + b cos x is sin(x + phase), and cos(x + phase - pi/2): take the one with no phase, or a half turn.
        phase = float(np.arctan2(fit[1], fit[0]))
        if abs(np.sin(phase)) < 1e-3:
            return self._named("sin", dofs, coefficients * np.sign(fit[0]), 0.0, "")
        offset = (phase - np.pi / 2 + np.pi) % (2 * np.pi) - np.pi
        return self._named("cos", dofs, coefficients, 0.0 if abs(offset) < 1e-3 else offset, "")

    def _named(self, quantity: Quantity, dofs: Dofs, coefficients: NDArray, offset: float, unit: str) -> Element:
        names = tuple(self.joints[int(dof)].name for dof in dofs)
        digits = digits_of(float(np.abs(coefficients).max()))
        rounded = tuple(round(float(c), digits) for c in coefficients)
        return Element(f"{'+'.join(names)}.{quantity}", quantity, names, rounded, round(offset, 4) + 0.0, unit)


def digits_of(largest: float) -> int:
    """Decimals to which numbers are rounded: four, and more if all of them are small."""
    return 4 if largest >= 0.1 or not largest else 3 - math.floor(math.log10(largest))


def height_name(model: mujoco.MjModel, column: int) -> str:
    """Name what a column of `Samples.height` is the height of."""
    for count, name_of in (
        (model.nbody, lambda k: model.body(k).name),
        (model.nbody, lambda k: f"{model.body(k).name}.centre_of_mass"),
        (model.ngeom, lambda k: model.geom(k).name or model.body(int(model.geom_bodyid[k])).name),
        (model.nsite, lambda k: model.site(k).name),
        (model.nbody, lambda k: f"{model.body(k).name}.subtree"),
    ):
        if column < count:
            return name_of(column)
        column -= count
    raise AssertionError


def _tolerance(y: NDArray, noise: float) -> float:
    """The largest misfit of a form that fits."""
    return TOLERANCE * max(1.0, float(np.ptp(y))) + 6 * noise


def _least_squares(design: NDArray, y: NDArray, tolerance: float) -> NDArray | None:
    solution = np.linalg.lstsq(design, y, rcond=None)[0]
    misfit = np.abs(design @ solution - y).max()
    return solution if misfit <= tolerance else None


def _matching_column(y: NDArray, columns: NDArray, tolerance: float) -> int | None:
    if np.ptp(y) <= tolerance:  # what stands still is no height, of the ground neither
        return None
    misfit = np.abs(columns - y[:, None]).max(axis=0)
    best = int(np.flatnonzero(misfit <= misfit.min() + 1e-9)[0])  # the first of those that differ by rounding
    return best if misfit[best] <= tolerance else None
