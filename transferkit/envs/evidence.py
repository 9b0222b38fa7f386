"""Evidence for the meaning of observations: what they respond to, and what they are over random states."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from transferkit.physics import mujoco

FREE, BALL = int(mujoco.mjtJoint.mjJNT_FREE), int(mujoco.mjtJoint.mjJNT_BALL)

SAMPLES = 24
"""Random states; a wrong form would have to fit all of them."""

NUDGES = 3
"""Random states from which each degree of freedom is moved by itself."""

MOTIONS, STEPS_PER_MOTION = 20, 20
"""Random pushes, and physics steps of each."""


@dataclass(frozen=True)
class Evidence:
    """What each element of the observation responds to."""

    positions: NDArray[np.bool_]
    """`(obs_dim, nv)`."""
    velocities: NDArray[np.bool_]
    """`(obs_dim, nv)`."""
    controls: NDArray[np.bool_]
    """`(obs_dim,)`."""
    motion: NDArray[np.bool_]
    """`(obs_dim,)`: it changes while the controls push and things collide."""


@dataclass(frozen=True)
class Samples:
    """Observations and candidate signals over random states; the first axis is the state."""

    observation: NDArray[np.floating]
    position: NDArray[np.floating]
    """Per degree of freedom; NaN for the rotations of free and ball joints, which have no angle."""
    velocity: NDArray[np.floating]
    height: NDArray[np.floating]
    """z of every body, body centre of mass, geom, site and of every subtree's centre of mass."""


class Prober:
    """Moves a simulation and watches its observation; the order of its methods fixes the random states."""

    def __init__(
        self, model: mujoco.MjModel, data: mujoco.MjData, observe: Callable[[], NDArray[np.floating]], obs_dim: int
    ) -> None:
        self.model, self.data, self.observe, self.obs_dim = model, data, observe, obs_dim
        self._rng = np.random.default_rng(0)
        self._start = data.qpos.copy()

    def evidence(self) -> Evidence:
        """Find what each element responds to."""
        return Evidence(*self._dependence(), self._force_dependence(), self._varies_in_motion())

    def samples(self) -> Samples:
        """Observe random states."""
        rows = []
        addresses = [self._angle_address(dof) for dof in range(self.model.nv)]
        for _ in range(SAMPLES):
            self._randomize()
            observation = self._observe()
            position = [np.nan if a is None else self.data.qpos[a] for a in addresses]
            d = self.data
            heights = np.concatenate([x[:, 2] for x in (d.xpos, d.xipos, d.geom_xpos, d.site_xpos, d.subtree_com)])
            rows.append((observation, position, self.data.qvel.copy(), heights))
        return Samples(*(np.array(column) for column in zip(*rows, strict=True)))

    def _randomize(self) -> None:
        """Draw a random state well inside the joint ranges."""
        self.data.qpos[:] = self._start
        for j in range(self.model.njnt):
            address = self.model.jnt_qposadr[j]
            if self.model.jnt_type[j] in (FREE, BALL):
                continue
            low, high = self.model.jnt_range[j] if self.model.jnt_limited[j] else (-2.0, 2.0)
            middle, reach = (low + high) / 2, 0.45 * min(high - low, 4.0)
            self.data.qpos[address] = self._rng.uniform(middle - reach, middle + reach)
        free = np.array([joint for joint in range(self.model.nv) if self._angle_address(joint) is None], int)
        step = np.zeros(self.model.nv)
        step[free] = self._rng.uniform(-0.3, 0.3, len(free))
        mujoco.mj_integratePos(self.model, self.data.qpos, step, 1.0)
        self.data.qvel[:] = self._rng.uniform(-1.0, 1.0, self.model.nv)
        self.data.ctrl[:] = 0.0

    def _observe(self) -> NDArray[np.float64]:
        mujoco.mj_forward(self.model, self.data)
        return np.array(self.observe(), np.float64)

    def _angle_address(self, dof: int) -> int | None:
        """Address in qpos of a slide's or hinge's coordinate; None for a free or ball joint's rotation."""
        j = int(self.model.dof_jntid[dof])
        within = dof - int(self.model.jnt_dofadr[j])
        if self.model.jnt_type[j] == BALL or (self.model.jnt_type[j] == FREE and within > 2):
            return None
        return int(self.model.jnt_qposadr[j]) + within

    def _dependence(self) -> tuple[NDArray[np.bool_], NDArray[np.bool_]]:
        """Move each degree of freedom by itself, as a position and as a velocity."""
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
        """Move the controls alone."""
        self._randomize()
        before = self._observe()
        self.data.ctrl[:] = self._random_controls()
        return _changed(before, self._observe())

    def _varies_in_motion(self) -> NDArray[np.bool_]:
        """Let the controls push."""
        self._randomize()
        first = self._observe()
        varied = np.zeros(self.obs_dim, bool)
        for _ in range(MOTIONS):
            self.data.ctrl[:] = self._random_controls()
            for _ in range(STEPS_PER_MOTION):
                mujoco.mj_step(self.model, self.data)
            varied |= _changed(first, self._observe())
        return varied

    def _random_controls(self) -> NDArray[np.float64]:
        limited = self.model.actuator_ctrllimited.astype(bool)
        bounds = np.where(limited[:, None], self.model.actuator_ctrlrange, [-1.0, 1.0])
        return bounds[np.arange(self.model.nu), self._rng.integers(0, 2, self.model.nu)]


def _changed(before: NDArray[np.float64], after: NDArray[np.float64]) -> NDArray[np.bool_]:
    return np.abs(after - before) > 1e-6 * (1 + np.abs(before))
