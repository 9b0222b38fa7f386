"""Damage and forgery: bytes, JSON values and TOML tokens, changed by a random generator."""

from __future__ import annotations

import copy
import json
from collections.abc import Callable, Sequence
from typing import Any

import numpy as np

Random = np.random.Generator

PLANTED = "planted_module"
"""A module that nothing may import."""

NUMBERS = (0, 1, -1, 2, 3, 7, 2**31, 2**53, 2**63, 2**64, -(2**63), 10**400, 1e308, -1e308, 1e-320, 0.5, -0.0, 1e39)
TEXTS = ("", "a", "none", "1", "NaN", "\n", "\0", "ü", "²", "\x1b[31mred\x1b[0m", "\ud800", "x" * 100_000)
PLACES = ("../../x", "/dev/zero", "a:b:c", ":X", "..:X", f"{PLANTED}:X-v0")
LISTS = ([], {}, [[]], [None], {"": None}, [0] * 1000, {"a": {"b": {"c": []}}})
NASTY: Sequence[Any] = (None, True, False, float("nan"), float("inf"), *NUMBERS, *TEXTS, *PLACES, *LISTS)
"""Values that stand where another one is expected."""

VALUES = (
    "nan",
    "-inf",
    "1e999",
    "-1",
    "0",
    "0x10",
    "9" * 500,
    "99999999999999999999",
    "1.5",
    "true",
    "1979-05-27",
    '"0-99999"',
)
STRINGS = ('""', "'a'", '"\\ud800"', '"\\u001b[31m"', '"../x"', '"$\\\\frac{$"', f'"{PLANTED}:X-v0"', '"a:b:c"', '":X"')
SIGNS = ("'''", '"""', "[", "]", "[[", "{", "}", "=", "#", "\x00", "\ufeff", "\r")
TABLES = ("[[]]", "{}", "[1.5]", "[0, 1, 1]", '["a"]', "[" * 5000, "a." * 2000 + "a=1")
TOKENS = (*VALUES, *STRINGS, *SIGNS, *TABLES)
"""Pieces of text that stand where another one is expected."""


def in_bytes(data: bytes, random: Random) -> bytes:
    """Change bytes: a bit, a run, the length, the order."""
    if not data:
        return bytes(random.integers(0, 256, 10, np.uint8))
    at, width = int(random.integers(len(data))), int(random.choice([1, 1, 2, 4, 8, 64, 1000]))
    noise = bytes(random.integers(0, 256, width, np.uint8))
    ways: Sequence[Callable[[], bytes]] = (
        lambda: data[:at] + bytes([data[at] ^ (1 << int(random.integers(8)))]) + data[at + 1 :],
        lambda: data[:at] + noise + data[at + width :],
        lambda: data[:at] + bytes(width) + data[at + width :],
        lambda: data[:at] + b"\xff" * width + data[at + width :],
        lambda: data[:at],
        lambda: data[:at] + data[at + width :],
        lambda: data[:at] + noise + data[at:],
        lambda: data[:at] + data[at : at + width] * 2 + data[at + width :],
        lambda: data + noise,
        lambda: data[at:] + data[:at],
    )
    return ways[int(random.choice(len(ways), p=[0.4, *[0.6 / 9] * 9]))]()


def in_json(value: Any, random: Random) -> Any:  # noqa: ANN401 - JSON
    """Change one to three places of a JSON value, which is copied."""
    value = json.loads(json.dumps(value))
    for _ in range(int(random.choice([1, 1, 1, 2, 3]))):
        value = _change(value, random)
    return value


def as_text(value: object, random: Random) -> bytes:
    """Write JSON, sometimes with something in it that is none."""
    text = json.dumps(value)
    way = int(random.integers(60))
    if way == 0:
        return text.replace("1", "1e400", 1).encode()
    if way == 1:
        return b"[" * 100_000 + text.encode()
    if way == 2:
        return text.replace(":", ":" + "[" * 600 + "]" * 600 + ",", 1).encode()
    if way == 3:
        return text.replace('"', '"\udc80', 1).encode(errors="surrogateescape")
    return text.encode()


def in_tokens(text: str, random: Random) -> str:
    """Change a text of lines `name = value`: a value, a name, a line."""
    lines = text.splitlines()
    for _ in range(int(random.choice([1, 1, 2]))):
        at = int(random.integers(len(lines)))
        token = TOKENS[int(random.integers(len(TOKENS)))]
        name, equals, value = lines[at].partition("=")
        ways = (
            f"{name}= {token}",
            f"{token} = {value}",
            lines[at] + token,
            "",
            f"{lines[at]}\n{lines[at]}",
            lines[int(random.integers(len(lines)))],
            f"{name}{equals}[{value}]",
        )
        lines[at] = ways[int(random.integers(len(ways)))]
    return "\n".join(lines) + "\n"


def _change(value: Any, random: Random) -> Any:  # noqa: ANN401 - JSON
    places = _places(value)
    if not places:
        return copy.deepcopy(NASTY[int(random.integers(len(NASTY)))])
    parent, key = places[int(random.integers(len(places)))]
    way, other = int(random.integers(10)), places[int(random.integers(len(places)))]
    if way < 5:
        parent[key] = copy.deepcopy(NASTY[int(random.integers(len(NASTY)))])
    elif way == 5:
        del parent[key]
    elif way == 6 and isinstance(parent[key], int | float):
        parent[key] = min(parent[key], 2**60) * float(random.normal(1, 10)) + float(random.normal(0, 10))
    elif way == 7 and isinstance(parent, list):
        parent.insert(key, json.loads(json.dumps(parent[key])))
    elif way == 8:
        parent[key] = json.loads(json.dumps(other[0][other[1]]))
    elif isinstance(parent, dict):
        parent[f"{key}x"] = parent.pop(key)
    return value


def _places(value: object) -> list[tuple[Any, Any]]:
    """Every container in a value with each of its keys."""
    found, open_ones = [], [value]
    while open_ones:
        node = open_ones.pop()
        keys = list(node) if isinstance(node, dict) else range(len(node)) if isinstance(node, list) else []
        found += [(node, key) for key in keys]
        open_ones += [node[key] for key in keys] if isinstance(node, dict | list) else []
    return found
