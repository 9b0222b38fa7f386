"""What probing must leave as it was: the generators of an environment's noise, and what its wrappers have learnt."""

from __future__ import annotations

import copy
import functools
import pickle
import random
import types
from collections import deque
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from typing import Any

import gymnasium
import numpy as np

from transferkit.envs.layers import layers_of
from transferkit.envs.simulation import attributes

DEPTH = 6
"""How far below an environment its generators are looked for."""

PLAIN = (bool, int, float, complex, str, bytes, type(None), np.generic)
CLOSED = (*PLAIN, np.ndarray, type, types.ModuleType, gymnasium.Space)
"""Kinds of values that hold no generator."""

LEARNS = "update_running_mean"
"""Attribute of Gymnasium's normalising wrappers."""

Restore = Callable[[], object]


class Pin:
    """The state of a random generator as it was."""

    def __init__(self, get: Callable[[], Any], put: Callable[[Any], object]) -> None:
        self._get, self._put, self._state = get, put, get()

    def moved(self) -> bool:
        """Whether something has been drawn."""
        return pickle.dumps(self._get()) != pickle.dumps(self._state)

    def restore(self) -> None:
        """Bring the state back."""
        self._put(self._state)

    def renewed(self) -> Pin:
        """The state as it is now."""
        return Pin(self._get, self._put)


def generators(env: gymnasium.Env) -> list[Pin]:
    """Note the state of every random generator that an environment reaches, and of the global ones."""
    layers = layers_of(env)
    found = [Pin(np.random.get_state, np.random.set_state), Pin(random.getstate, random.setstate)]
    for value in _reached([*layers, *_functions(layers)]):
        if isinstance(value, np.random.Generator):
            found.append(_of_generator(value))
        elif isinstance(value, np.random.RandomState):
            found.append(Pin(value.get_state, value.set_state))
        elif isinstance(value, random.Random):
            found.append(Pin(value.getstate, value.setstate))
    return found


@contextmanager
def undisturbed(env: gymnasium.Env) -> Iterator[None]:
    """Keep what an environment's wrappers hold (a history, statistics, counters), and stop what learns meanwhile."""
    wrappers = layers_of(env)[:-1]
    kept = [_attribute(one, name, value) for one in wrappers for name, value in vars(one).items() if _is_plain(value)]
    for wrapper in wrappers:
        if LEARNS in dir(type(wrapper)):
            setattr(wrapper, LEARNS, False)
    try:
        yield
    finally:
        for restore in kept:
            restore()


def learning_wrappers(env: gymnasium.Env) -> list[str]:
    """Names of the wrappers that change what numbers mean while they learn."""
    return [type(one).__name__ for one in layers_of(env)[:-1] if getattr(one, LEARNS, False) is True]


def _attribute(holder: object, name: str, value: Any) -> Restore:  # noqa: ANN401 - plain
    saved = copy.deepcopy(value)
    if not isinstance(value, np.ndarray):
        return lambda: setattr(holder, name, copy.deepcopy(saved))

    def restore() -> None:
        np.copyto(value, saved)  # it may be a view of something else
        setattr(holder, name, value)  # and another may stand in its place by now

    return restore


def _is_plain(value: object, depth: int = 3) -> bool:
    if isinstance(value, (*PLAIN, np.ndarray)):
        return True
    if depth and isinstance(value, list | tuple | deque | set):
        return all(_is_plain(item, depth - 1) for item in value)
    if depth and isinstance(value, dict):
        return all(_is_plain(item, depth - 1) for item in value.values())
    return bool(depth) and type(value).__name__ == "RunningMeanStd"


def _functions(layers: list[gymnasium.Env]) -> list[object]:
    """The functions of their classes, which may draw from a generator of their module."""
    return [part for one in layers for part in vars(type(one)).values() if isinstance(part, types.FunctionType)]


def _reached(level: list[object]) -> Iterator[object]:
    seen: set[int] = set()
    for _ in range(DEPTH):
        level = [value for value in level if not isinstance(value, CLOSED) and id(value) not in seen]
        seen |= {id(value) for value in level}
        yield from level
        level = [part for value in level for part in _parts(value)]


def _parts(value: Any) -> Iterator[object]:  # noqa: ANN401 - any object
    """What an object holds: attributes, items, and what a function or a method is bound to."""
    yield from attributes(value).values()
    if isinstance(value, types.MethodType):
        yield from (value.__self__, value.__func__)
    elif isinstance(value, functools.partial):
        yield from (value.func, *value.args, *value.keywords.values())
    elif isinstance(value, dict):
        yield from value.values()
    elif isinstance(value, list | tuple | deque | set) and len(value) < 1000:
        yield from value
    elif isinstance(value, types.FunctionType):
        yield from (cell.cell_contents for cell in value.__closure__ or () if cell.cell_contents is not value)
        yield from value.__defaults__ or ()
        yield from (value.__globals__.get(name) for name in value.__code__.co_names)


def _of_generator(generator: np.random.Generator) -> Pin:
    bits = generator.bit_generator
    return Pin(lambda: bits.state, lambda state: setattr(bits, "state", state))
