"""Checks of configurations: each field's type, its choices, and the range that stands beside it."""

from __future__ import annotations

import functools
import math
import types
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Annotated, Any, Literal, Union, get_args, get_origin, get_type_hints

from transferkit.errors import SettingError, did_you_mean


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
        return above and below and math.isfinite(number)

    def __str__(self) -> str:
        low = f"{'above' if self.open_low else 'at least'} {self.low:g}"
        high = f"{'below' if self.open_high else 'at most'} {self.high:g}"
        return low if math.isinf(self.high) else high if math.isinf(self.low) else f"{low} and {high}"


AT_LEAST_ONE, NOT_NEGATIVE, POSITIVE = Range(1), Range(0), Range(0, open_low=True)
SHARE, RATE = Range(0, 1), Range(0, 1, open_low=True)


def check(config: object, section: str = "", *, not_empty: str = "") -> None:
    """Check every field of a configuration against its annotation; the field `not_empty` needs at least one item.

    Raises:
        SettingError: a value has another type, is not among the choices, or is out of its range.
    """
    if not_empty and getattr(config, not_empty) == ():
        raise SettingError(f"{section}.{not_empty}", value=(), allowed="at least one number")
    for name, hint in _hints(type(config)).items():
        value, setting = getattr(config, name), f"{section}.{name}" if section else name
        if wanted := _unfit(value, hint):
            raise SettingError(setting, value=value, allowed=wanted)


def _unfit(value: object, hint: Any) -> str:  # noqa: ANN401 - a type hint is any object
    """What a value must be instead; empty if it fits its type hint."""
    kind, arguments = get_origin(hint), get_args(hint)
    if kind in (Union, types.UnionType):
        return "" if any(not _unfit(value, one) for one in arguments) else _unfit(value, arguments[0])
    if kind is Annotated:
        return _unfit(value, arguments[0]) or _out_of_range(value, arguments[1])
    if kind is Literal:
        return "" if value in arguments else _choice(value, arguments)
    if kind is tuple:
        reasons = [_unfit(item, arguments[0]) for item in (value if isinstance(value, tuple) else [None])]
        return next((f"a list, each item {reason}" for reason in reasons if reason), "")
    if kind is not None:
        return "" if isinstance(value, kind) else "a table of names and values"
    allowed = (int, float) if hint is float else hint
    return "" if isinstance(value, allowed) and (hint is bool or not isinstance(value, bool)) else WORDS.get(hint, str(hint))


WORDS = {int: "a whole number", float: "a number", bool: "true or false", str: "a string", type(None): "none"}


def _out_of_range(value: object, allowed: object) -> str:
    fits = not isinstance(allowed, Range) or not isinstance(value, int | float) or value in allowed
    return "" if fits else str(allowed)


def _choice(value: object, choices: tuple[object, ...]) -> str:
    names = [str(choice) for choice in choices]
    return "; ".join(filter(None, (" or ".join(names), did_you_mean(str(value), names))))


@functools.cache
def _hints(kind: type) -> Mapping[str, Any]:
    own = {name for base in kind.__mro__ for name in getattr(base, "__dataclass_fields__", {})}
    hints = get_type_hints(kind, include_extras=True)
    return {name: hint for name, hint in hints.items() if name in own and (get_origin(hint) is not None or hint in WORDS)}
