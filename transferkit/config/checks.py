"""Checks of configurations: each field's type, its choices, and the range that stands beside it."""

from __future__ import annotations

import functools
import math
import types
from collections.abc import Mapping, Sequence, Sized
from dataclasses import dataclass
from typing import Annotated, Any, Literal, Union, get_args, get_origin, get_type_hints

from transferkit.errors import ConfigError, SettingError, did_you_mean


@dataclass(frozen=True)
class Range:
    """The numbers that a field may have, as `Annotated` metadata."""

    low: float = -math.inf
    high: float = math.inf
    open_low: bool = False
    """The lower end itself is not allowed."""
    open_high: bool = False
    """The upper end itself is not allowed."""

    def __contains__(self, number: float) -> bool:
        above = self.low < number if self.open_low else self.low <= number
        below = number < self.high if self.open_high else number <= self.high
        return above and below and abs(number) < math.inf

    def __str__(self) -> str:
        low = f"{'above' if self.open_low else 'at least'} {self.low:,}"
        high = f"{'below' if self.open_high else 'at most'} {self.high:,}"
        return low if math.isinf(self.high) else high if math.isinf(self.low) else f"{low} and {high}"


@dataclass(frozen=True)
class Items:
    """The lengths that a list may have, as `Annotated` metadata."""

    most: int

    def __contains__(self, items: Sized) -> bool:
        return 1 <= len(items) <= self.most

    def __str__(self) -> str:
        return f"at least one number and at most {self.most:,}"


class Different:
    """That no item of a list occurs twice, as `Annotated` metadata."""

    def __contains__(self, items: Sequence[object]) -> bool:
        return len(set(items)) == len(items)

    def __str__(self) -> str:
        return "different from each other"


AT_LEAST_ONE, NOT_NEGATIVE, POSITIVE = Range(1), Range(0), Range(0, open_low=True)
SHARE, RATE = Range(0, 1), Range(0, 1, open_low=True)
EPISODES = Range(1, 1_000_000)
"""Episodes of an evaluation or a recording."""
WIDTH, BATCH, MEMBERS = Range(1, 8192), Range(1, 65_536), Range(1, 64)
"""Sizes of what is allocated: a slip of the finger is refused, and does not fill the memory."""

Seed = Annotated[int, NOT_NEGATIVE]
"""Seed of random streams."""

Hidden = Annotated[tuple[Annotated[int, WIDTH], ...], Items(16)]
"""Hidden layers of a network."""

LARGEST = 2**63 - 1
"""Whole numbers beyond it are none that numpy, torch or a file could hold."""


def check(config: object, section: str = "") -> None:
    """Check every field of a configuration against its annotation.

    Raises:
        SettingError: a value has another type, is not among the choices, or is out of its range.
    """
    for name, hint in _hints(type(config)).items():
        value = plain(getattr(config, name))
        object.__setattr__(config, name, value)  # of a frozen one that is being made
        check_value(f"{section}.{name}" if section else name, value, hint)


def check_value(name: str, value: object, hint: Any) -> None:  # noqa: ANN401 - a type hint is any object
    """Check one value against a type hint.

    Raises:
        SettingError: it does not fit.
    """
    if wanted := unfit(value, hint):
        raise SettingError(name, value=value, allowed=wanted)


def check_kind(name: str, value: object, kind: type | tuple[type, ...], remedy: str) -> None:
    """Check the type of what a function of the public interface is given.

    Raises:
        ConfigError: it is something else.
    """
    if not isinstance(value, kind):
        kinds = " or ".join(one.__name__ for one in (kind if isinstance(kind, tuple) else (kind,)))
        raise ConfigError(f"{name} is of type {type(value).__name__} and not {kinds}", remedy=remedy)


def unfit(value: object, hint: Any) -> str:  # noqa: ANN401 - a type hint is any object
    """What a value must be instead; empty if it fits its type hint."""
    value = plain(value)
    kind, arguments = get_origin(hint), get_args(hint)
    if kind in (Union, types.UnionType):
        return "" if any(not unfit(value, one) for one in arguments) else unfit(value, arguments[0])
    if kind is Annotated:
        return unfit(value, arguments[0]) or next((str(rule) for rule in arguments[1:] if value not in rule), "")
    if kind is Literal:
        return "" if value in arguments else _choice(value, arguments)
    if kind is tuple:
        reasons = [unfit(item, arguments[0]) for item in (value if isinstance(value, tuple) else [None])]
        return next((f"a list, each item {reason}" for reason in reasons if reason), "")
    if kind is not None:
        return "" if isinstance(value, kind) else "a table of names and values"
    return _unfit_plain(value, hint)


def plain(value: Any) -> Any:  # noqa: ANN401 - any value
    """The value with Python's numbers in place of numpy's, in a tuple too."""
    if isinstance(value, tuple):
        return tuple(map(plain, value))
    return value.item() if type(value).__module__ == "numpy" and getattr(value, "ndim", None) == 0 else value


WORDS = {int: "a whole number", float: "a number", bool: "true or false", str: "a string", type(None): "none"}


def _unfit_plain(value: object, kind: type) -> str:
    allowed = (int, float) if kind is float else kind
    if not isinstance(value, allowed) or (isinstance(value, bool) and kind is not bool):
        return WORDS.get(kind, str(kind))
    if isinstance(value, int):
        return "" if abs(value) <= LARGEST else f"at most {LARGEST:,}"
    return "a finite number" if isinstance(value, float) and not math.isfinite(value) else ""


def _choice(value: object, choices: tuple[object, ...]) -> str:
    names = [str(choice) for choice in choices]
    return "; ".join(filter(None, (" or ".join(names), did_you_mean(str(value), names))))


@functools.cache
def _hints(kind: type) -> Mapping[str, Any]:
    own = {name for base in kind.__mro__ for name in getattr(base, "__dataclass_fields__", {})}
    hints = get_type_hints(kind, include_extras=True)
    return {name: hint for name, hint in hints.items() if name in own and (get_origin(hint) is not None or hint in WORDS)}
