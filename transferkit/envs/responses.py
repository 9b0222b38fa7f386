"""What actions do at the reference pose: what the actuators are told, and the forces and accelerations that follow."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray
from scipy.optimize import root_scalar

from transferkit.envs.frozen import Look, State
from transferkit.envs.joints import BALL, FREE
from transferkit.envs.memory import DRAWS, LONGEST, QUIET
from transferkit.physics import mujoco

if TYPE_CHECKING:
    from transferkit.envs.frozen import Frozen
    from transferkit.envs.simulation import Simulation

SHARES = (1 / 64, 1.0)
"""Actions that are tried each way: small ones are not clipped, large ones overcome friction."""

NUDGE = 0.05
"""How far a joint is moved about, in m or rad, and how fast, in m/s or rad/s."""

NEGLIGIBLE = 1e-6
"""Of the largest force on a degree of freedom."""

EVEN = 1e-3
"""Share of what an action changes that counts as none."""

NEAR = 1e-4
"""How near to an action that does nothing is near enough."""

LOOKED = ("control", "force", "acceleration")

UNBIASED = [int(kind) for kind in (mujoco.mjtBias.mjBIAS_NONE, mujoco.mjtBias.mjBIAS_MUSCLE)]
"""Kinds of actuators that are told to do nothing by a control of zero."""


@dataclass(frozen=True)
class Responses:
    """What actions do at the reference pose."""

    none: Look
    """No action."""
    looks: Sequence[Sequence[tuple[float, Look]]]
    """For every element of the action: its values, the small ones first, and what each did."""
    elsewhere: Sequence[tuple[Look, Look, Look]]
    """All elements of the action where they do nothing, and no action: at rest, with every joint elsewhere, and in motion."""
    nudges: NDArray[np.float64]
    """`(nv,)`: how far, and how fast."""
    rest: Sequence[tuple[float, Look] | None]
    """For every element of the action: the value, and what it did, that does nothing, or as little as any; None if unknown."""
    noise: Look
    """Deviations by which a look differs from another of the same action."""
    accumulates: bool
    """Whether an action goes on changing what the actuators are told."""

    def pushes(self, k: int) -> NDArray[np.float64]:
        """The largest change of each force by an action, `(nv,)`; 0 where noise explains it."""
        return _certain([look.force - self.none.force for _, look in self.looks[k]], self.noise.force)

    def drives(self, k: int) -> NDArray[np.intp]:
        """The actuators that an action tells something."""
        return np.flatnonzero(_certain([look.control - self.none.control for _, look in self.looks[k]], self.noise.control))


class Responder:
    """Acts in an environment that is held still and watches its simulation."""

    def __init__(self, frozen: Frozen, simulation: Simulation, act_dim: int, rng: np.random.Generator) -> None:
        self._frozen, self._model, self._act_dim, self._rng = frozen, simulation.model, act_dim, rng
        self._idle = State(simulation.model.qpos0, np.zeros(simulation.model.nv), np.zeros(act_dim, np.float32))
        self._noisy, self._settling = False, 0

    def responses(self) -> Responses:
        """See what each action does."""
        self._frozen.pinned = False  # an action that is late by chance comes in the end
        idle = [self._frozen.look(self._idle) for _ in range(4 * QUIET)]
        accumulates, noise = _adds_up(idle), self._noise(idle[2 * QUIET :])
        steps = 2 * QUIET
        if not self._noisy and not accumulates:
            steps, accumulates = self._steps_to_settle()
        self._settling = steps + (2 * QUIET if self._frozen.noisy else 0)
        each = [[(share, self._act(k, share)) for share in self._shares()] for k in range(self._act_dim)]
        none, nudges = self._see(self._idle), self._nudges()
        made = Responses(none, each, (), nudges, (), noise, accumulates)
        rest = [None if accumulates else self._rest(k, made) for k in range(self._act_dim)]
        resting = np.array([0.0 if one is None else np.clip(one[0], -1, 1) for one in rest], np.float32)
        elsewhere = [self._elsewhere(action, nudges) for action in (resting, *([self._idle.action] if resting.any() else []))]
        self._frozen.pinned = True
        return replace(made, rest=rest, elsewhere=elsewhere)

    def _elsewhere(self, action: NDArray[np.float32], nudges: NDArray[np.float64]) -> tuple[Look, Look, Look]:
        """See what an action does at rest, with every joint elsewhere, and in motion."""
        state, position = replace(self._idle, action=action), self._idle.qpos.copy()
        mujoco.mj_integratePos(self._model, position, nudges, 1.0)
        return self._see(state), self._see(replace(state, qpos=position)), self._see(replace(state, qvel=nudges))

    def _shares(self) -> Iterable[float]:
        """Both ways, the small ones first; those say nothing in noise."""
        return (sign * share for share in (SHARES[1:] if self._noisy else SHARES) for sign in (1, -1))

    def _nudges(self) -> NDArray[np.float64]:
        """Move no two joints alike: what depends on their difference is seen, too."""
        nv = self._model.nv
        scalar = ~np.isin(self._model.jnt_type[self._model.dof_jntid], (FREE, BALL))
        return NUDGE * scalar * (-1.0) ** np.arange(nv) * (1 + np.arange(nv) * 0.618 % 1)

    def _noise(self, looks: Sequence[Look]) -> Look:
        """How much looks at the same action differ."""
        self._noisy = not all(look.like(looks[0]) for look in looks)
        if not self._noisy:
            return _over(looks[:1], lambda seen: np.zeros(seen.shape[1:]))
        return _over(looks, lambda seen: 8 * seen.std(axis=0) / np.sqrt(DRAWS))

    def _steps_to_settle(self) -> tuple[int, bool]:
        """Steps after the first until an action has reached the simulation as far as it ever does; whether it accumulates."""
        action = self._rng.uniform(-1.0, 1.0, self._act_dim).astype(np.float32)
        looks, last_news = [self._frozen.look(self._idle)], 0
        while len(looks) - 1 - last_news < 2 * QUIET and len(looks) < LONGEST:
            looks.append(self._frozen.look(replace(self._idle, action=action)))
            if not looks[-1].like(looks[-2]):
                last_news = len(looks) - 1
        return max(0, last_news - 1), _adds_up(looks)

    def _rest(self, k: int, made: Responses) -> tuple[float, Look] | None:
        """The value of an action that does nothing: no control, or no force of what is a servo."""
        driven = made.drives(k)
        told = len(driven) and np.isin(self._model.actuator_biastype[driven], UNBIASED).all()
        pushed = made.pushes(k)
        on = np.flatnonzero(pushed > NEGLIGIBLE * pushed.max(initial=0.0))
        looks = dict(made.looks[k])

        def of(look: Look) -> NDArray[np.float64]:
            return look.control[driven] if told else look.force[on]

        way = of(looks[1.0]) - of(looks[-1.0])
        if not way.any():
            return None
        blur = of(made.noise) @ np.abs(way) + EVEN * way @ way

        def effect(look: Look) -> float:
            effect = float(of(look) @ way)
            return 0.0 if abs(effect) <= blur else effect

        return self._find_rest(k, looks | {0.0: made.none}, effect)

    def _find_rest(self, k: int, looks: dict[float, Look], effect: Callable[[Look], float]) -> tuple[float, Look]:
        """Find where an effect is none: where a line says so, by bisection, or else where it is least."""
        effects = {share: effect(look) for share, look in looks.items()}

        def seen(share: float) -> float:
            return effects[share] if share in effects else effect(self._act(k, share))

        near = min(share for share in looks if share > 0)
        slope, bend = (effects[near] - effects[-near]) / (2 * near), effects[near] + effects[-near] - 2 * effects[0.0]
        if not effects[0.0]:
            return 0.0, looks[0.0]
        if slope:
            guess = -effects[0.0] / slope
            straight = np.isclose(effects[1.0] - effects[-1.0], 2 * slope, rtol=1e-2) and abs(bend) < near * abs(slope) / 2
            if abs(guess) > 1 and straight:
                return guess, looks[0.0]
            if abs(guess) <= 1 and not effect(look := self._act(k, guess)):
                return guess, look
        for low, high in ((0.0, 1.0), (-1.0, 0.0)):
            if effects[low] * effects[high] < 0:
                share = root_scalar(seen, bracket=(low, high), method="bisect", xtol=NEAR).root
                return share, self._act(k, share)
        least = min(effects, key=lambda share: abs(effects[share]))
        return least, looks[least]

    def _act(self, k: int, share: float) -> Look:
        action = self._idle.action.copy()
        action[k] = share
        return self._see(replace(self._idle, action=action))

    def _see(self, state: State) -> Look:
        self._frozen.see_all([state] * self._settling)
        looks = [self._frozen.look(state) for _ in range(DRAWS if self._noisy else 1)]
        return _over(looks, lambda seen: seen.mean(axis=0))


def _over(looks: Sequence[Look], reduce: Callable[[NDArray[np.float64]], NDArray[np.float64]]) -> Look:
    control, force, acceleration = (reduce(np.array([getattr(look, name) for look in looks])) for name in LOOKED)
    return Look(control, force, acceleration)


def _adds_up(looks: Sequence[Look]) -> bool:
    """Whether the actuators are told more by the same amount with every step."""
    told = np.diff([look.control for look in looks], axis=0)
    steady = told[int(told.any(axis=1).argmax()) :][: QUIET // 2] if told.any() else told[:0]
    return len(steady) == QUIET // 2 and np.allclose(steady, steady[0], rtol=1e-2, atol=1e-9)


def _certain(changes: Sequence[NDArray[np.float64]], noise: NDArray[np.float64]) -> NDArray[np.float64]:
    largest = np.max(np.abs(changes), axis=0, initial=0.0)
    return np.where(largest > noise, largest, 0.0)
