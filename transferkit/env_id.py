"""An environment in writing: its id, keyword arguments, and what is varied: `Hopper-v5?frame_skip=8&vary.mass=1.3`.

A value is JSON where it is any, and else a word. `&`, `?`, `%` and white space in words are written as in a URL, `%26`.
"""

from __future__ import annotations

import json
import re
from collections.abc import Iterable, Mapping
from dataclasses import dataclass, field, replace
from typing import Any
from urllib.parse import quote, unquote

from transferkit.errors import ConfigError

VARY = "vary."
"""What the names of variations begin with."""

PLAIN = "/:,.[]{}\"'+-_~*()!$;@="
"""Signs in a value that stay as they are."""


NUMBER = re.compile(r"[+-]?(\d+\.|\.\d+)(e[+-]?\d+)?", re.ASCII | re.IGNORECASE)
"""Numbers that people write and JSON does not: `1.`, `.5`."""


@dataclass(frozen=True)
class EnvId:
    """The parts of an environment in writing."""

    id: str
    """Of Gymnasium's registry, perhaps behind the module that registers it."""
    kwargs: Mapping[str, Any] = field(default_factory=dict)
    """JSON values by name."""
    variation: Mapping[str, Any] = field(default_factory=dict)
    """JSON values by name; a dot leads into a table: `length.thigh`."""

    @classmethod
    def read(cls, text: str) -> EnvId:
        """Take it apart.

        Raises:
            ConfigError: an argument without a name or a value, or a name twice.
        """
        name, _, query = text.partition("?")
        given = _assignments(query.split("&") if query else [], "argument", text)
        kwargs = {key: value for key, value in given.items() if not key.startswith(VARY)}
        return cls(name, kwargs, {key.removeprefix(VARY): value for key, value in given.items() if key.startswith(VARY)})

    def with_arguments(self, kwargs: Iterable[str] = (), variation: Iterable[str] = ()) -> EnvId:
        """Add `name=value` words, in place of those of the same name.

        Raises:
            ConfigError: a word without a name or a value, or a name twice.
        """
        more = _assignments(list(kwargs), "argument", self.id)
        varied = _assignments(list(variation), "variation", self.id)
        return replace(self, kwargs={**self.kwargs, **more}, variation={**self.variation, **varied})

    def __str__(self) -> str:
        parts = [f"{name}={_written(value)}" for name, value in self.kwargs.items()]
        parts += [f"{VARY}{name}={_written(value)}" for name, value in self.variation.items()]
        return f"{self.id}?{'&'.join(parts)}" if parts else self.id


def brief(text: str) -> str:
    """An environment in writing, perhaps a stranger's, for a cell of a table: what is varied does not fit."""
    name, _, query = text.partition("?")
    return f"{name}, varied" if VARY in query else text


def _assignments(words: list[str], what: str, env: str) -> dict[str, Any]:
    given: dict[str, Any] = {}
    for word in words:
        name, equals, value = word.partition("=")
        if not (name and equals and value):
            raise ConfigError(f"{what} of environment {env}", value=word, allowed="NAME=VALUE")
        if name in given:
            raise ConfigError(f"environment {env} has {name} twice", remedy="leave one out", topic="environments")
        given[name] = _value(unquote(value))
    return given


def _value(text: str) -> Any:  # noqa: ANN401 - any JSON value
    if NUMBER.fullmatch(text):
        return float(text)
    try:
        return json.loads(text, parse_constant=lambda _: text)
    except (ValueError, RecursionError):
        low, dots, high = text.partition("..")
        ends = _numbers(low, high) if dots else None
        return text if ends is None else ends


def _numbers(*words: str) -> list[float] | None:
    """The ends of a range `0.7..1.3`."""
    try:
        return [float(word) for word in words]
    except ValueError:
        return None


def _written(value: object) -> str:
    text = json.dumps(value, separators=(",", ":"))
    if isinstance(value, str) and _value(value) == value:
        text = value
    return quote(text, safe=PLAIN)
