"""What an observation remembers: how old each element is, what changes by itself, and how noisy it is.

A state is held until nothing new comes, then another one: the step in which an element takes notice is its age.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

if TYPE_CHECKING:
    from transferkit.envs.frozen import Frozen, State

SAMPLES = 24
"""Random states; a wrong form would have to fit all of them."""

QUIET, LONGEST = 8, 128
"""Steps without news after which nothing older is expected, and the most that are waited for."""

DRAWS = 32
"""Observations of one state with noise."""


@dataclass(frozen=True)
class Memory:
    """Of each element of the observation, `(obs_dim,)`."""

    age: NDArray[np.intp]
    """Control steps since what it says was true."""
    noise: NDArray[np.float64]
    """Deviation that could not be switched off."""
    doubt: NDArray[np.float64]
    """Standard error of its mean, of all noise."""
    time: NDArray[np.bool_]
    """It grows by the same in every step, whatever happens."""
    mixed: NDArray[np.bool_]
    """It says something of several steps at once."""
    bias: NDArray[np.float64]
    """What the one draw of noise, which all observations have, adds to the mean."""


def measure_memory(frozen: Frozen, states: Sequence[State]) -> Memory:
    """Hold states, the first until everything has settled, and see when the others are noticed."""
    calm = _hold(frozen, states[0])[1:][-3 * QUIET :]
    steps = np.diff(calm, axis=0)
    restless = _restless(calm)
    time = restless & (np.ptp(steps, axis=0) <= 1e-5 * np.abs(steps).max(axis=0))
    drifts = restless & (np.abs(steps.sum(axis=0)) > 0.5 * np.abs(steps).sum(axis=0))
    noise = np.where(restless & ~drifts, calm.std(axis=0), 0.0)
    age, mixed, before = np.full(calm.shape[1], LONGEST), drifts & ~time, calm[-1]
    for state in states[1:]:
        after = _hold(frozen, state)
        first, moves_on = _notice(before, after, noise)
        age, mixed, before = np.minimum(age, first), mixed | (moves_on & ~restless), after[-1]
    age[(age == LONGEST) | time | mixed] = 0
    bias, doubt = _noise_mean(frozen, states[0], int(age.max(initial=0)))
    return Memory(age, noise, doubt, time, mixed, np.where((noise == 0) & ~time & ~mixed, bias, 0.0))


def _restless(seen: NDArray[np.float64]) -> NDArray[np.bool_]:
    return changed(seen[:-1], seen[1:]).all(axis=0)


def changed(
    before: NDArray[np.float64], after: NDArray[np.float64], noise: NDArray[np.float64] | float = 0.0
) -> NDArray[np.bool_]:
    """Where two observations differ by more than rounding and noise explain."""
    return np.abs(after - before) > 1e-6 * (1 + np.abs(before)) + 8 * noise


def _hold(frozen: Frozen, state: State) -> NDArray[np.float64]:
    """Observe a state until nothing new comes, `(steps, obs_dim)`; what changes in every step is no news."""
    seen, last_news = [frozen.see(state)], 0
    always = np.ones(len(seen[0]), bool)
    while len(seen) - 1 - last_news < QUIET * (3 if always.any() else 1) and len(seen) < LONGEST:
        seen.append(frozen.see(state))
        moved = changed(seen[-2], seen[-1])
        begun = len(seen) > 2
        news, always = (moved & ~always) | (always & ~moved & begun), always & moved
        last_news = len(seen) - 1 if news.any() else last_news
    return np.array(seen)


def _notice(
    before: NDArray[np.float64], after: NDArray[np.float64], noise: NDArray[np.float64]
) -> tuple[NDArray[np.intp], NDArray[np.bool_]]:
    """The step in which each element first differs from before, and whether it goes on changing from there."""
    news = changed(before, after, noise)
    first = np.where(news.any(axis=0), news.argmax(axis=0), LONGEST)
    at_first = np.take_along_axis(after, np.minimum(first, len(after) - 1)[None], axis=0)
    later = np.arange(len(after))[:, None] > first
    return first, np.asarray((changed(after, at_first, noise) & later).any(axis=0))


def _noise_mean(frozen: Frozen, state: State, oldest: int) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """What the one draw of noise that all observations have adds, and the standard error of the mean of noise."""
    pinned = frozen.see_all([state] * (1 + oldest))[-1]
    frozen.pinned = False
    free = frozen.see_all([state] * 2)
    if (free != pinned).any():
        free = frozen.see_all([state] * DRAWS)
    frozen.pinned = True
    return pinned - free.mean(axis=0), free.std(axis=0) / np.sqrt(min(DRAWS, SAMPLES))
