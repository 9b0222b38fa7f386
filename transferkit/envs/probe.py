"""Derive an `IOSpec` from the physics: move every coordinate and see which observation element answers, and how.

Two kinds of evidence. *Dependence*: from random states, one degree of freedom at a time is moved; an element depends on
those that change it. *Form*: over many random states an element is compared with candidate signals (each coordinate, the
sine and cosine of each angle and of sums of angles, the heights of bodies); one that fits all states names it.
"""

# pyright: reportAttributeAccessIssue=false
# mujoco's names come from compiled modules that pyright cannot read.
from __future__ import annotations

import itertools
from collections import Counter
from dataclasses import dataclass, replace

import gymnasium
import mujoco
import numpy as np
from numpy.typing import NDArray

from transferkit.envs.access import Simulation, open_simulation
from transferkit.envs.joints import BALL, FREE, read_actuators, read_joints
from transferkit.envs.make import episode_limit, make_env, time_step
from transferkit.spec import Element, IOSpec, Joint
from transferkit.versions import versions

SAMPLES = 24
"""Random states; a wrong form would have to fit all of them."""

NUDGES = 3
"""Random states from which each degree of freedom is moved by itself."""

TOLERANCE = 2e-5
"""Largest misfit of a form, relative to the element's spread (observations are float32)."""

MOTIONS, STEPS_PER_MOTION = 20, 20
"""Random pushes, and physics steps of each."""

LARGEST_SUM = 5
"""Angles in a sum that are searched for signs."""


def derive_spec(env: str | gymnasium.Env) -> IOSpec:
    """The meaning of an environment's observation and action; the environment's state is lost (reset it afterwards).

    Works for every MuJoCo environment of either backend; where the backend does not let the observation be asked for,
    and outside MuJoCo, every element is `unknown`. An id is looked at once a process, as long as it names the same.
    """
    if not isinstance(env, str):
        return _derive(env)
    registered = gymnasium.registry.get(env)
    if env not in _DERIVED or _DERIVED[env][0] is not registered:
        _DERIVED[env] = registered, _derive(env)
    return _DERIVED[env][1]


_DERIVED: dict[str, tuple[object, IOSpec]] = {}
"""What Gymnasium had registered under an id, and what it was found to be."""


def _derive(env: str | gymnasium.Env) -> IOSpec:
    made = make_env(env)
    made.reset(seed=0)
    raw = made.env  # type: ignore[attr-defined] - below the scaling of actions
    low, high = raw.action_space.low, raw.action_space.high
    simulation = open_simulation(raw)
    obs_dim = made.observation_space.shape[0]  # type: ignore[index]
    env_id = env if isinstance(env, str) else (made.spec.id if made.spec else type(made.unwrapped).__name__)
    common = {
        "env_id": env_id,
        "time_step": time_step(made),
        "episode_limit": episode_limit(made),
        "versions": {name: versions()[name] for name in ("mujoco", "gymnasium", "dm-control")},
    }
    try:
        if simulation is None:
            unknown = tuple(Element(f"observation[{i}]", "unknown", (), (), 0.0, "") for i in range(obs_dim))
            actuators = read_actuators(low, high, _NoModel, [])
            return IOSpec(backend="other", observation=unknown, action=tuple(actuators), joints=(), **common)
        joints = _reference_joints(simulation)
        actuators = read_actuators(low, high, simulation.model, joints)
        elements = _Prober(simulation, joints, obs_dim).elements()
        return IOSpec(
            backend=simulation.backend,
            observation=tuple(elements),
            action=tuple(actuators),
            joints=tuple(joints),
            **common,
        )
    finally:
        if isinstance(env, str):
            made.close()


class _NoModel:
    nu = -1


def _reference_joints(simulation: Simulation) -> list[Joint]:
    data = mujoco.MjData(simulation.model)
    mujoco.mj_forward(simulation.model, data)
    return read_joints(simulation.model, data)


@dataclass
class _Samples:
    """Observations and candidate signals over random states; the first axis is the state."""

    observation: NDArray[np.floating]
    position: NDArray[np.floating]
    """Per degree of freedom; NaN for the rotations of free and ball joints, which have no angle."""
    velocity: NDArray[np.floating]
    height: NDArray[np.floating]
    """z of every body, body centre of mass, geom, site and of every subtree's centre of mass."""


class _Prober:
    def __init__(self, simulation: Simulation, joints: list[Joint], obs_dim: int) -> None:
        self.simulation, self.joints, self.obs_dim = simulation, joints, obs_dim
        self.model, self.data = simulation.model, simulation.data
        self.rng = np.random.default_rng(0)
        self.start = self.data.qpos.copy()

    def elements(self) -> list[Element]:
        if self.simulation.observe is None:
            return [Element(label, "unknown", (), (), 0.0, "") for label in self.simulation.labels]
        evidence = _Evidence(*self._dependence(), self._force_dependence(), self._varies_in_motion())
        samples = self._sample()
        return _unique([self._element(i, evidence, samples) for i in range(self.obs_dim)])

    def _randomize(self) -> None:
        """A random state well inside the joint ranges."""
        self.data.qpos[:] = self.start
        for j in range(self.model.njnt):
            address = self.model.jnt_qposadr[j]
            if self.model.jnt_type[j] in (FREE, BALL):
                continue
            low, high = self.model.jnt_range[j] if self.model.jnt_limited[j] else (-2.0, 2.0)
            middle, reach = (low + high) / 2, 0.45 * min(high - low, 4.0)
            self.data.qpos[address] = self.rng.uniform(middle - reach, middle + reach)
        free = np.array([joint for joint in range(self.model.nv) if self._angle_address(joint) is None], int)
        step = np.zeros(self.model.nv)
        step[free] = self.rng.uniform(-0.3, 0.3, len(free))
        mujoco.mj_integratePos(self.model, self.data.qpos, step, 1.0)
        self.data.qvel[:] = self.rng.uniform(-1.0, 1.0, self.model.nv)
        self.data.ctrl[:] = 0.0

    def _observe(self) -> NDArray[np.float64]:
        mujoco.mj_forward(self.model, self.data)
        assert self.simulation.observe is not None
        return np.array(self.simulation.observe(), np.float64)

    def _angle_address(self, dof: int) -> int | None:
        """Address in qpos of a slide's or hinge's coordinate; None for a free or ball joint's rotation."""
        j = int(self.model.dof_jntid[dof])
        within = dof - int(self.model.jnt_dofadr[j])
        if self.model.jnt_type[j] == BALL or (self.model.jnt_type[j] == FREE and within > 2):
            return None
        return int(self.model.jnt_qposadr[j]) + within

    def _dependence(self) -> tuple[NDArray[np.bool_], NDArray[np.bool_]]:
        """Which degrees of freedom, as position and as velocity, each element responds to, `(obs_dim, nv)`."""
        positions = np.zeros((self.obs_dim, self.model.nv), bool)
        velocities = np.zeros_like(positions)
        for _ in range(NUDGES):
            self._randomize()
            qpos, qvel = self.data.qpos.copy(), self.data.qvel.copy()
            before = self._observe()
            for dof in range(self.model.nv):
                nudge = np.zeros(self.model.nv)
                nudge[dof] = 0.05
                mujoco.mj_integratePos(self.model, self.data.qpos, nudge, 1.0)
                positions[:, dof] |= _changed(before, self._observe())
                self.data.qpos[:] = qpos
                self.data.qvel[dof] += 0.05
                velocities[:, dof] |= _changed(before, self._observe())
                self.data.qvel[:] = qvel
        return positions, velocities

    def _force_dependence(self) -> NDArray[np.bool_]:
        """Which elements respond to the controls alone, `(obs_dim,)`."""
        self._randomize()
        before = self._observe()
        self.data.ctrl[:] = self._random_controls()
        return _changed(before, self._observe())

    def _varies_in_motion(self) -> NDArray[np.bool_]:
        """Which elements change while the controls push and things collide, `(obs_dim,)`."""
        self._randomize()
        first = self._observe()
        found = np.zeros(self.obs_dim, bool)
        for _ in range(MOTIONS):
            self.data.ctrl[:] = self._random_controls()
            for _ in range(STEPS_PER_MOTION):
                mujoco.mj_step(self.model, self.data)
            found |= _changed(first, self._observe())
        return found

    def _random_controls(self) -> NDArray[np.float64]:
        limited = self.model.actuator_ctrllimited.astype(bool)
        bounds = np.where(limited[:, None], self.model.actuator_ctrlrange, [-1.0, 1.0])
        return bounds[np.arange(self.model.nu), self.rng.integers(0, 2, self.model.nu)]

    def _sample(self) -> _Samples:
        rows = []
        addresses = [self._angle_address(dof) for dof in range(self.model.nv)]
        for _ in range(SAMPLES):
            self._randomize()
            observation = self._observe()
            position = [np.nan if a is None else self.data.qpos[a] for a in addresses]
            d = self.data
            heights = np.concatenate([x[:, 2] for x in (d.xpos, d.xipos, d.geom_xpos, d.site_xpos, d.subtree_com)])
            rows.append((observation, position, self.data.qvel.copy(), heights))
        return _Samples(*(np.array(column) for column in zip(*rows, strict=True)))

    def _element(self, i: int, evidence: _Evidence, samples: _Samples) -> Element:
        positions, velocities = np.flatnonzero(evidence.positions[i]), np.flatnonzero(evidence.velocities[i])
        y = samples.observation[:, i]
        label = self.simulation.labels[i]
        form = None
        if len(positions) and not len(velocities):
            form = self._position_form(y, positions, samples)
        elif len(velocities) and not len(positions):
            form = self._linear("velocity", y, velocities, samples.velocity)
        if form is not None:
            return form
        names = tuple(self.joints[dof].name for dof in sorted({*positions, *velocities}))
        if evidence.controls[i] or (not names and evidence.motion[i]):
            return Element(label, "force", names, (), 0.0, "")
        if not names:
            return Element(label, "constant", (), (), 0.0, "")
        return Element(label, f"function of {'velocity' if len(velocities) else 'position'}", names, (), 0.0, "")

    def _position_form(self, y: NDArray, dofs: NDArray[np.intp], samples: _Samples) -> Element | None:
        height = _matching_column(y, samples.height)
        form = self._linear("position", y, dofs, samples.position)
        if form is not None and not (height is not None and len(dofs) > 1):
            return form
        hinges_only = all(self.joints[dof].type == "hinge" for dof in dofs)
        if hinges_only and len(dofs) <= LARGEST_SUM and np.isfinite(samples.position[:, dofs]).all():
            for signs in itertools.product((1.0, -1.0), repeat=len(dofs) - 1):
                coefficients = np.array((1.0, *signs))
                form = self._trigonometric(y, dofs, coefficients, samples.position[:, dofs] @ coefficients)
                if form is not None:
                    return form
        if height is not None:
            names = tuple(self.joints[dof].name for dof in dofs)
            return Element(f"{self._height_name(height)}.height", "height", names, (), 0.0, "m")
        return None

    def _linear(self, quantity: str, y: NDArray, dofs: NDArray[np.intp], signal: NDArray) -> Element | None:
        columns = signal[:, dofs]
        if not np.isfinite(columns).all() or 2 * len(dofs) >= SAMPLES:
            return None
        fit = _least_squares(np.column_stack([columns, np.ones(SAMPLES)]), y)
        if fit is None:
            return None
        unit = "m" if self.joints[dofs[0]].type == "slide" else "rad"
        unit = unit if len({self.joints[dof].type for dof in dofs}) == 1 else ""
        suffix = "/s" if quantity == "velocity" and unit else ""
        return self._named(quantity, dofs, fit[:-1], float(fit[-1]), unit + suffix)

    def _trigonometric(self, y: NDArray, dofs: NDArray[np.intp], coefficients: NDArray, angle: NDArray) -> Element | None:
        fit = _least_squares(np.column_stack([np.sin(angle), np.cos(angle), np.ones(SAMPLES)]), y)
        if fit is None or abs(fit[2]) > 1e-3 or abs(np.hypot(fit[0], fit[1]) - 1) > 1e-3:
            return None
        # a sin x + b cos x is sin(x + phase), and cos(x + phase - pi/2): take the one with no phase, or a half turn.
        phase = float(np.arctan2(fit[1], fit[0]))
        if abs(np.sin(phase)) < 1e-3:
            return self._named("sin", dofs, coefficients * np.sign(fit[0]), 0.0, "")
        offset = (phase - np.pi / 2 + np.pi) % (2 * np.pi) - np.pi
        return self._named("cos", dofs, coefficients, 0.0 if abs(offset) < 1e-3 else offset, "")

    def _named(self, quantity: str, dofs: NDArray[np.intp], coefficients: NDArray, offset: float, unit: str) -> Element:
        names = tuple(self.joints[dof].name for dof in dofs)
        rounded = tuple(round(float(c), 4) for c in coefficients)
        return Element(f"{'+'.join(names)}.{quantity}", quantity, names, rounded, round(offset, 4) + 0.0, unit)

    def _height_name(self, column: int) -> str:
        model = self.model
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


@dataclass
class _Evidence:
    """What each element responds to."""

    positions: NDArray[np.bool_]
    """`(obs_dim, nv)`."""
    velocities: NDArray[np.bool_]
    """`(obs_dim, nv)`."""
    controls: NDArray[np.bool_]
    """`(obs_dim,)`."""
    motion: NDArray[np.bool_]
    """`(obs_dim,)`."""


def _least_squares(design: NDArray, y: NDArray) -> NDArray | None:
    solution = np.linalg.lstsq(design, y, rcond=None)[0]
    misfit = np.abs(design @ solution - y).max()
    return solution if misfit <= TOLERANCE * max(1.0, float(np.ptp(y))) else None


def _matching_column(y: NDArray, columns: NDArray) -> int | None:
    misfit = np.abs(columns - y[:, None]).max(axis=0)
    best = int(np.argmin(misfit))
    return best if misfit[best] <= TOLERANCE * max(1.0, float(np.ptp(y))) else None


def _changed(before: NDArray[np.float64], after: NDArray[np.float64]) -> NDArray[np.bool_]:
    return np.abs(after - before) > 1e-6 * (1 + np.abs(before))


def _unique(elements: list[Element]) -> list[Element]:
    seen: Counter[str] = Counter()
    result = []
    for element in elements:
        seen[element.name] += 1
        copies = seen[element.name]
        result.append(element if copies == 1 else replace(element, name=f"{element.name}#{copies}"))
    return result
