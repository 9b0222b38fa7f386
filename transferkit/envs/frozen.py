"""An environment whose simulated time stands still: what it observes in any state, and what an action does there.

Every step goes through all wrappers and the environment's own code, as the user built them; only the model's time step is so
small that the state stays what it was set to.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING

import gymnasium
import numpy as np
from numpy.typing import NDArray

from transferkit.envs.memento import generators
from transferkit.envs.simulation import COUNTERS, attributes, counts
from transferkit.errors import TransferkitError
from transferkit.physics import mujoco

if TYPE_CHECKING:
    from types import TracebackType

    from transferkit.envs.memento import Pin
    from transferkit.envs.simulation import Simulation

MOMENT = 1e-13
"""Seconds of a physics step; an acceleration of 1e6 moves a velocity by less than what counts as a change."""

STEPPING = {**dict.fromkeys(COUNTERS, 1), "legacy_step": False}
"""Attributes by which a control step is one whole physics step."""

STEPS = ("mj_step", "mj_step1", "mj_step2")
"""MuJoCo's functions that let time pass."""

FOLLOWING = [int(getattr(mujoco.mjtDyn, f"mjDYN_{kind}")) for kind in ("FILTER", "FILTEREXACT", "MUSCLE", "INTEGRATOR")]
"""Dynamics of actuators whose activation goes where the control is, or of an integrator, is there in a second."""

RESISTANCE = int(mujoco.mjtDisableBit.mjDSBL_LIMIT) | int(mujoco.mjtDisableBit.mjDSBL_FRICTIONLOSS)
"""What would hold a joint that an action pushes: the reference pose may be outside its range."""

ENDING = "_reset_next_step"
"""Attribute of dm_control's environments, set when an episode has ended."""

TRIES = 3
"""Steps until the environment is where it was put; one that resets itself after an episode needs two."""


class ElusiveError(Exception):
    """The environment does not stay in the state that it is put into."""


@dataclass(frozen=True)
class State:
    """A state to look at, and the action that is taken there."""

    qpos: NDArray[np.float64]
    qvel: NDArray[np.float64]
    action: NDArray[np.float32]
    act: NDArray[np.float64] | float = 0.0
    """Activations of muscles and filters."""


@dataclass(frozen=True)
class Look:
    """What an action did in a state."""

    control: NDArray[np.float64]
    """`(nu,)`: what the actuators got."""
    force: NDArray[np.float64]
    """`(nv,)`: forces of the actuators and applied ones."""
    acceleration: NDArray[np.float64]
    """`(nv,)`."""
    actuator: NDArray[np.float64]
    """`(nu,)`: forces of the actuators, along their transmission."""

    def like(self, other: Look) -> bool:
        """Whether control and force are the same but for rounding."""
        pairs = ((self.control, other.control), (self.force, other.force))
        return all(np.allclose(own, another, rtol=1e-9, atol=1e-12) for own, another in pairs)


class Frozen:
    """Holds an environment still, as a context; afterwards its time runs and its generators are as before."""

    def __init__(self, env: gymnasium.Env, simulation: Simulation, pace: float, *, by_clock: bool = False) -> None:
        """Take an environment under the contract, the simulated time of its steps, and whether they wait for a time to come."""
        self._env, self._simulation, self._pace, self._by_clock = env, simulation, pace, by_clock
        self._clock = 0.0
        self.pinned = True
        """Whether all noise is drawn from the same state of its generators in every step."""
        self.time_step = simulation.model.opt.timestep
        """Seconds of a physics step when time runs."""

    def __enter__(self) -> Frozen:
        self._generators = generators(self._env)
        self._noisy: list[Pin] | None = None
        option = self._simulation.model.opt
        self._integrator = option.integrator
        keepers = self._simulation.keepers
        self._stepping = [(own, name, attributes(own)[name]) for own in keepers for name in STEPPING if counts(own, name)]
        for keeper, name, _ in self._stepping:
            setattr(keeper, name, STEPPING[name])
        self._real = {name: getattr(mujoco, name) for name in STEPS} if self._by_clock else {}
        for name in self._real:
            setattr(mujoco, name, _stand)
        self._ending = [keeper for keeper in keepers if ENDING in attributes(keeper)]
        return self

    def __exit__(self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None) -> None:
        option = self._simulation.model.opt
        option.timestep, option.integrator = self.time_step, self._integrator
        for keeper, name, value in self._stepping:
            setattr(keeper, name, value)
        for name, step in self._real.items():
            setattr(mujoco, name, step)
        for pin in self._generators:
            pin.restore()

    def see(self, state: State) -> NDArray[np.float64]:
        """Put the environment into a state and take a step there; returns the observation `(obs_dim,)`.

        Raises:
            ElusiveError: the step leads elsewhere.
        """
        self._clock += self._pace
        for attempt in range(TRIES):
            self._put(state)
            try:
                observation = self._env.step(state.action)[0]
            except TransferkitError:
                if attempt == TRIES - 1:
                    raise
                self._env.reset(seed=0)  # some allow no step after the end of an episode
                continue
            if self._noisy is None:
                self._noisy = [pin for pin in self._generators if pin.moved()]
            data = self._simulation.data
            if _near(data.qpos, state.qpos) and _near(data.qvel, state.qvel):
                return observation.astype(np.float64)
        raise ElusiveError("a step does not begin in the state that the simulation is in")

    def see_all(self, states: Sequence[State]) -> NDArray[np.float64]:
        """Observe one state after the other, `(len(states), obs_dim)`."""
        return np.array([self.see(state) for state in states])

    @property
    def noisy(self) -> bool:
        """Whether an environment draws anything in a step."""
        return bool(self._noisy)

    def redraw(self) -> None:
        """Hold the noise at its next draw."""
        self._noisy = [pin.renewed() for pin in self._noisy or ()]

    def look(self, state: State) -> Look:
        """What an action does in a state."""
        self.see(state)
        model, data = self._simulation.model, self._simulation.data
        data.qpos[:], data.qvel[:] = state.qpos, state.qvel  # exactly: a contact may be a hair's breadth away
        _settle_activations(model, data)
        flags, model.opt.disableflags = model.opt.disableflags, model.opt.disableflags | RESISTANCE
        mujoco.mj_forward(model, data)
        model.opt.disableflags = flags
        force = data.qfrc_actuator + data.qfrc_applied
        if data.xfrc_applied.any():
            force = force + _of_bodies(model, data)
        return Look(data.ctrl.copy(), force, data.qacc.copy(), data.actuator_force.copy())

    def _put(self, state: State) -> None:
        model, data = self._simulation.model, self._simulation.data
        model.opt.timestep = self.time_step if self._by_clock else MOMENT
        model.opt.integrator = mujoco.mjtIntegrator.mjINT_EULER
        data.time = self._clock
        data.qpos[:], data.qvel[:], data.act[:], data.qacc_warmstart[:] = state.qpos, state.qvel, state.act, 0.0
        for keeper in self._ending:
            setattr(keeper, ENDING, False)
        for pin in (self._noisy or ()) if self.pinned else ():
            pin.restore()


def _stand(model: mujoco.MjModel, data: mujoco.MjData, nstep: int = 1) -> None:
    """In place of MuJoCo's steps, for an environment that waits until a time has come: time passes, and nothing moves."""
    mujoco.mj_forward(model, data)
    data.time += nstep * model.opt.timestep


def _near(now: NDArray[np.float64], then: NDArray[np.float64]) -> bool:
    return bool((np.abs(now - then) <= 1e-3 * (1 + np.abs(then))).all())


def _settle_activations(model: mujoco.MjModel, data: mujoco.MjData) -> None:
    """Let filters and muscles have what their control leads to."""
    settling = np.flatnonzero(np.isin(model.actuator_dyntype, FOLLOWING))
    low, high = np.where(model.actuator_actlimited[:, None].astype(bool), model.actuator_actrange, [-np.inf, np.inf]).T
    last = model.actuator_actadr + model.actuator_actnum - 1
    data.act[last[settling]] = np.clip(data.ctrl, low, high)[settling]


def _of_bodies(model: mujoco.MjModel, data: mujoco.MjData) -> NDArray[np.float64]:
    """Forces on bodies as forces on degrees of freedom."""
    force = np.zeros(model.nv)
    for body in np.flatnonzero(data.xfrc_applied.any(axis=1)):
        wrench = data.xfrc_applied[body]
        mujoco.mj_applyFT(model, data, wrench[:3], wrench[3:], data.xipos[body], int(body), force)
    return force
