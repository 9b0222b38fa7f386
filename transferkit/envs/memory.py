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

MOSTLY = 0.9
"""Share of steps in which what never rests says something else."""

DRAWS = 16
"""Draws of noise that samples are averaged over."""


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


def measure_memory(frozen: Frozen, states: Sequence[State]) -> Memory:
    """Hold states, the first until everything has settled, and see when the others are noticed."""
    calm = _hold(frozen, states[0])[1:][-3 * QUIET :]
    restless, growth = _restless(calm), np.diff(calm, axis=0).mean(axis=0)
    time = restless & _grows(calm, growth)
    smooth = restless & ~time & _smooth(calm)
    noise = np.where(restless & ~time & ~smooth, calm.std(axis=0), 0.0)
    age, mixed, before = np.full(calm.shape[1], LONGEST), smooth, calm[-1]
    for state in states[1:]:
        after = _hold(frozen, state)
        first, moves_on = _notice(before, after, noise)
        wavers = time & ~_grows(after, growth)
        age, mixed, before = np.minimum(age, first), mixed | wavers | (moves_on & ~restless), after[-1]
    time = time & ~mixed
    age[(age == LONGEST) | time | mixed] = 0
    doubt = _noise_of_mean(frozen, states[0]) if frozen.noisy or noise.any() else np.zeros_like(noise)
    return Memory(age, noise, doubt, time, mixed)


def _grows(seen: NDArray[np.float64], growth: NDArray[np.float64]) -> NDArray[np.bool_]:
    """Whether an element changes by the same in every step."""
    return np.asarray((np.abs(np.diff(seen, axis=0) - growth) <= 1e-4 * np.abs(growth)).all(axis=0))


def _smooth(seen: NDArray[np.float64]) -> NDArray[np.bool_]:
    """Whether an element that never rests moves along rather than about: a clock, a filter, a running mean."""
    centred = seen - seen.mean(axis=0)
    power = (centred**2).sum(axis=0)
    return np.asarray((centred[1:] * centred[:-1]).sum(axis=0) > 0.6 * power)


def _restless(seen: NDArray[np.float64]) -> NDArray[np.bool_]:
    """Whether an element never rests; noise may say twice the same by chance."""
    return np.asarray(changed(seen[:-1], seen[1:]).mean(axis=0) > MOSTLY)


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


def _noise_of_mean(frozen: Frozen, state: State) -> NDArray[np.float64]:
    """Standard error of the mean over as many draws of noise as samples are averaged over."""
    frozen.pinned = False
    free = frozen.see_all([state] * 2 * DRAWS)
    frozen.pinned = True
    return free.std(axis=0) / np.sqrt(DRAWS)
