"""What actions do at the reference pose: what the actuators are told, and the forces and accelerations that follow."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass, fields, replace
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
"""Force, as a share of the largest that an action causes, that counts as none."""

EVEN = 1e-3
"""Share of what an action changes that counts as none."""

NEAR = 1e-4
"""How near to an action that does nothing is near enough."""

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
    rest: Sequence[tuple[float, Look] | None]
    """For every element of the action: the value, and what it did, that does nothing, or as little as any; None if unknown."""
    noise: Look
    """Deviations by which a look differs from another of the same action."""
    lasting: NDArray[np.bool_]
    """`(nu,)`: what an actuator is told stays when the action has ended."""

    def pushes(self, k: int) -> NDArray[np.float64]:
        """The largest change of each force by an action, `(nv,)`; 0 where noise explains it."""
        return _certain([look.force - self.none.force for _, look in self.looks[k]], self.noise.force)

    def adds_up(self, k: int) -> bool:
        """Whether an action changes something for good."""
        return bool(self.lasting[self.drives(k)].any())

    def effect(self, k: int, look: Look) -> NDArray[np.float64]:
        """What an action does: forces of the actuators that it drives, or of joints if it drives none."""
        driven = self.drives(k)
        return look.actuator[driven] if len(driven) else look.force[self.pushes(k) > 0]

    def drives(self, k: int) -> NDArray[np.intp]:
        """The actuators that an action tells something."""
        return np.flatnonzero(_certain([look.control - self.none.control for _, look in self.looks[k]], self.noise.control))


@dataclass(frozen=True)
class Held:
    """Looks at one action for a while."""

    looks: Sequence[Look]

    @property
    def settling(self) -> int:
        """Steps after the first until an action has reached the simulation as far as it ever does."""
        news = [k for k in range(1, len(self.looks)) if not self.looks[k].like(self.looks[k - 1])]
        return max(news, default=0)

    @property
    def noisy(self) -> bool:
        """Whether looks differ to the end as much as in the beginning: what settles slowly does not."""
        quarters = np.array_split([look.control for look in self.looks], 4)
        steps = [np.abs(np.diff(quarter, axis=0)).mean(axis=0) for quarter in (quarters[1], quarters[3])]
        return bool((steps[1] > steps[0] / 2 + EVEN * EVEN).any())


class Responder:
    """Acts in an environment that is held still and watches its simulation."""

    def __init__(self, frozen: Frozen, simulation: Simulation, act_dim: int, rng: np.random.Generator) -> None:
        self._frozen, self._model, self._act_dim, self._rng = frozen, simulation.model, act_dim, rng
        self._idle = State(simulation.model.qpos0, np.zeros(simulation.model.nv), np.zeros(act_dim, np.float32))
        self._noisy, self._settling = False, 0

    def responses(self) -> Responses:
        """See what each action does."""
        self._frozen.pinned = False  # an action that is late by chance comes in the end
        action = np.sign(self._rng.uniform(-1.0, 1.0, self._act_dim)).astype(np.float32)
        idle, acting, after = (self._hold(state) for state in (self._idle, replace(self._idle, action=action), self._idle))
        noise, lasting = self._noise(idle, acting), _lasting(idle, acting, after)
        settling = LONGEST // 4 if self._noisy else 2 * acting.settling + 1  # from one end to the other
        self._settling = settling + (2 * QUIET if self._frozen.noisy else 0)
        each = [[(share, self._act(k, share)) for share in self._shares()] for k in range(self._act_dim)]
        none, nudges = self._see(self._idle), self._nudges()
        made = Responses(none, each, (), (), noise, lasting)
        rest = [None if made.adds_up(k) else self._rest(k, made) for k in range(self._act_dim)]
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

    def _hold(self, state: State) -> Held:
        """Hold a state for as long as anything may take to come through."""
        return Held([self._frozen.look(state) for _ in range(LONGEST)])

    def _noise(self, *held: Held) -> Look:
        """How much looks at the same action differ."""
        self._noisy = any(one.noisy for one in held)
        if not self._noisy:
            return _over(held[0].looks[:1], lambda seen: np.zeros(seen.shape[1:]))
        spreads = [_over(one.looks[-2 * QUIET :], lambda seen: 8 * seen.std(axis=0) / np.sqrt(DRAWS)) for one in held]
        return _over(spreads, lambda seen: seen.max(axis=0))

    def _rest(self, k: int, made: Responses) -> tuple[float, Look] | None:
        """The value of an action that does nothing: no control, or no force of what is a servo."""
        driven, looks = made.drives(k), dict(made.looks[k])
        told = len(driven) and np.isin(self._model.actuator_biastype[driven], UNBIASED).all()

        def of(look: Look) -> NDArray[np.float64]:
            return look.control[driven] if told else made.effect(k, look)

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
    """Make one look of several, number by number."""
    return Look(*(reduce(np.array([getattr(look, field.name) for look in looks])) for field in fields(Look)))


def _lasting(before: Held, acting: Held, after: Held) -> NDArray[np.bool_]:
    """What has not come back when the action has ended."""
    first, last, end = (held.looks[-1].control for held in (before, acting, after))
    blur = 8 * np.std([look.control for look in before.looks[-2 * QUIET :]], axis=0) * before.noisy
    return np.abs(end - first) > np.maximum(np.abs(last - first) / 2, blur + EVEN * np.abs(last - first))


def _certain(changes: Sequence[NDArray[np.float64]], noise: NDArray[np.float64]) -> NDArray[np.float64]:
    largest = np.max(np.abs(changes), axis=0, initial=0.0)
    return np.where(largest > noise, largest, 0.0)
