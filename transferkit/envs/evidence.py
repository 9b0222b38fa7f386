"""Evidence for the meaning of observations: what they respond to, how late, and what they are over random states.

States are visited one after the other, once each; what an element says of a state is read as many steps later as it is old.
"""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from transferkit.envs.frozen import State
from transferkit.envs.joints import BALL, FREE
from transferkit.envs.memory import DRAWS, SAMPLES, changed, measure_memory
from transferkit.physics import mujoco

if TYPE_CHECKING:
    from transferkit.envs.frozen import Frozen
    from transferkit.envs.memory import Memory
    from transferkit.envs.simulation import Simulation


NUDGES = 3
"""Random states from which each degree of freedom is moved by itself."""

MANY = 40
"""Degrees of freedom from which on one state less is enough."""

MOTIONS, STEPS_PER_MOTION = 20, 10
"""Random pushes, and physics steps of each."""

LIFT = 0.3
"""Metres by which a floating body is moved away from where it stands: contacts take most of the time."""


@dataclass(frozen=True)
class Evidence:
    """What each element of the observation responds to; every array begins with `(obs_dim,)`."""

    positions: NDArray[np.bool_]
    """`(obs_dim, nv)`."""
    velocities: NDArray[np.bool_]
    """`(obs_dim, nv)`."""
    controls: NDArray[np.bool_]
    motion: NDArray[np.bool_]
    """It changes while the controls push and things collide."""
    actions: NDArray[np.float64]
    """`(obs_dim, act_dim)`: by how much it changes with an action, if it is a multiple of it."""
    memory: Memory


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
    """Moves an environment that is held still and watches it; the order of its methods fixes the random states."""

    def __init__(self, frozen: Frozen, simulation: Simulation, obs_dim: int, act_dim: int) -> None:
        self._frozen, self._simulation = frozen, simulation
        self._obs_dim, self._act_dim = obs_dim, act_dim
        self.rng = np.random.default_rng(0)
        self._start = simulation.data.qpos.copy()
        self._idle = np.zeros(act_dim, np.float32)
        self._memory = measure_memory(frozen, [self._random_state(self._random_action()) for _ in range(3)])

    def evidence(self) -> Evidence:
        """Find what each element responds to."""
        positions, velocities = self._dependence()
        stateless = ~(positions.any(1) | velocities.any(1))
        controls = self._control_dependence()
        actions = self._slopes() if (controls & stateless).any() else np.zeros((self._obs_dim, self._act_dim))
        silent = stateless & ~controls
        motion = self._varies_in_motion() if silent.any() else np.zeros_like(silent)
        return Evidence(positions, velocities, controls, motion, actions, self._memory)

    def samples(self) -> Samples:
        """Observe random states: the same ones for every robot that has the same joints and ranges."""
        self.rng, self._start = np.random.default_rng(0), self._simulation.model.qpos0.copy()
        states = [self._random_state() for _ in range(SAMPLES)]
        observation = self._averaged(states)
        model, data = self._simulation.model, self._simulation.data
        addresses = [_angle_address(model, dof) for dof in range(model.nv)]
        position = [[np.nan if a is None else state.qpos[a] for a in addresses] for state in states]
        heights = []
        for state in states:
            data.qpos[:] = state.qpos
            mujoco.mj_fwdPosition(model, data)
            heights.append(
                np.concatenate([x[:, 2] for x in (data.xpos, data.xipos, data.geom_xpos, data.site_xpos, data.subtree_com)])
            )
        return Samples(observation, np.array(position), np.array([state.qvel for state in states]), np.array(heights))

    def _averaged(self, states: Sequence[State]) -> NDArray[np.float64]:
        """What each element says of each state, over several draws of noise that are each the same in all states."""
        draws = []
        for _ in range(DRAWS if self._frozen.noisy else 1):
            draws.append(self._visit(states))
            self._frozen.redraw()
        return np.mean(draws, axis=0)

    def _visit(self, states: Sequence[State]) -> NDArray[np.float64]:
        """What each element says of each state, `(len(states), obs_dim)`."""
        oldest = int(self._memory.age.max(initial=0))
        seen = self._frozen.see_all([*states, *[states[-1]] * oldest])
        rows = np.arange(len(states))[:, None] + self._memory.age
        return seen[rows, np.arange(self._obs_dim)]

    def _random_state(self, action: NDArray[np.float32] | None = None) -> State:
        """Draw a state well inside the joint ranges."""
        model, qpos = self._simulation.model, self._start.copy()
        for j in range(model.njnt):
            if model.jnt_type[j] not in (FREE, BALL):
                low, high = model.jnt_range[j] if model.jnt_limited[j] else (-2.0, 2.0)
                middle, reach = (low + high) / 2, 0.45 * min(high - low, 4.0)
                qpos[model.jnt_qposadr[j]] = self.rng.uniform(middle - reach, middle + reach)
        floating = np.isin(model.jnt_type[model.dof_jntid], (FREE, BALL))
        slides = np.array([_angle_address(model, dof) is not None for dof in range(model.nv)], bool) & floating
        move = np.where(floating, self.rng.uniform(-0.3, 0.3, model.nv), 0.0)
        move[slides] += LIFT
        mujoco.mj_integratePos(model, qpos, move, 1.0)
        return State(qpos, self.rng.uniform(-1.0, 1.0, model.nv), self._idle if action is None else action)

    def _random_action(self) -> NDArray[np.float32]:
        return self.rng.uniform(-1.0, 1.0, self._act_dim).astype(np.float32)

    def _only(self, k: int, share: float) -> NDArray[np.float32]:
        action = self._idle.copy()
        action[k] = share
        return action

    def _dependence(self) -> tuple[NDArray[np.bool_], NDArray[np.bool_]]:
        """Move each degree of freedom by itself, as a position and as a velocity."""
        nv, states = self._simulation.model.nv, []
        bases = NUDGES if nv < MANY else NUDGES - 1
        for _ in range(bases):
            base = self._random_state()
            states += [base, *self._nudged(base)]
        seen = self._visit(states).reshape(bases, 1 + 2 * nv, self._obs_dim)
        answers = changed(seen[:, :1], seen[:, 1:], self._memory.noise).any(axis=0).T & ~self._memory.time[:, None]
        return answers[:, :nv], answers[:, nv:]

    def _nudged(self, base: State) -> Iterable[State]:
        model = self._simulation.model
        for nudge in 0.05 * np.eye(model.nv):
            qpos = base.qpos.copy()
            mujoco.mj_integratePos(model, qpos, nudge, 1.0)
            yield State(qpos, base.qvel, base.action)
        for nudge in 0.05 * np.eye(model.nv):
            yield State(base.qpos, base.qvel + nudge, base.action)

    def _control_dependence(self) -> NDArray[np.bool_]:
        """Change the actions alone."""
        base = self._random_state()
        seen = self._visit([base, *(State(base.qpos, base.qvel, self._random_action()) for _ in range(2))])
        return changed(seen[:1], seen[1:], self._memory.noise).any(axis=0) & ~self._memory.time

    def _slopes(self) -> NDArray[np.float64]:
        """By how much an element changes with each action, if that is the same in two states; else 0."""
        bases = [self._random_state() for _ in range(2)]
        each = [State(at.qpos, at.qvel, self._only(k, 0.5)) for at in bases for k in range(self._act_dim)]
        seen = self._visit([*bases, *each])
        slopes = (seen[2:].reshape(2, self._act_dim, -1) - seen[:2, None]) / 0.5
        alike = np.isclose(slopes[0], slopes[1], rtol=1e-4, atol=1e-6).all(axis=0)
        return np.where(alike, slopes[0], 0.0).T

    def _varies_in_motion(self) -> NDArray[np.bool_]:
        """Let the controls push, and look at where that leads."""
        model, states = self._simulation.model, []
        first = self._random_state()
        data = mujoco.MjData(model)
        data.qpos[:], data.qvel[:] = first.qpos, first.qvel
        pace, model.opt.timestep = model.opt.timestep, self._frozen.time_step
        for _ in range(MOTIONS):
            data.ctrl[:] = self._random_controls(model)
            mujoco.mj_step(model, data, STEPS_PER_MOTION)
            states.append(State(data.qpos.copy(), data.qvel.copy(), self._random_action(), data.act.copy()))
        model.opt.timestep = pace
        seen = self._visit([first, *states])
        return changed(seen[:1], seen[1:], self._memory.noise).any(axis=0) & ~self._memory.time

    def _random_controls(self, model: mujoco.MjModel) -> NDArray[np.float64]:
        limited = model.actuator_ctrllimited.astype(bool)
        bounds = np.where(limited[:, None], model.actuator_ctrlrange, [-1.0, 1.0])
        return bounds[np.arange(model.nu), self.rng.integers(0, 2, model.nu)]


def _angle_address(model: mujoco.MjModel, dof: int) -> int | None:
    """Address in qpos of a slide's or hinge's coordinate; None for a free or ball joint's rotation."""
    j = int(model.dof_jntid[dof])
    within = dof - int(model.jnt_dofadr[j])
    if model.jnt_type[j] == BALL or (model.jnt_type[j] == FREE and within > 2):
        return None
    return int(model.jnt_qposadr[j]) + within
