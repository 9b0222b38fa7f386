"""Grids of runs in TOML, checked before anything runs; `docs/experiments.md` has one with every key."""

from __future__ import annotations

import re
import tomllib
from collections.abc import Mapping
from dataclasses import fields
from pathlib import Path
from typing import Any, TypeGuard

from experiments.matrix.arms import ZERO_ACTION
from experiments.matrix.grid import Cell, Grid, GridError, Trainer, add, check_names
from experiments.matrix.table import ambiguity, identity
from transferkit.errors import ConfigError

WHOLE = ("episodes", "steps", "eval_every", "eval_episodes")
ITEMS = {"cores": str, "targets": str, "arms": str, "trainer": dict}
MOST = 10_000
"""Seeds, or members, of a grid."""

KINDS = {str: "names", dict: "tables, each written as [[trainer]]"}


def load_cells(path: Path) -> list[Cell]:
    """Every run of a grid's file, once, seed by seed: what has run at any moment is nearly the same for all arms.

    Raises:
        ConfigError: no such file, no TOML, an unknown key, or a value that cannot be, with its line.
    """
    try:
        text = path.read_text(encoding="utf-8-sig")
        data = tomllib.loads(text)
    except OSError as error:
        raise ConfigError(f"{path} cannot be read ({error.strerror}); grids lie in experiments/grids") from None
    except ValueError as error:
        raise ConfigError(f"{path} is no TOML: {error}") from None
    parts, cells = data.pop("part", [{}]), {}
    if not parts or not _is_list_of(dict, parts):
        raise ConfigError(f"{path}: part={parts!r} must be written as [[part]]")
    for k, part in enumerate(parts):
        try:
            for cell in _grid({**data, **part}).cells():
                add(cells, cell)
        except GridError as error:
            raise ConfigError(f"{path}{_line(text, k, error.where)}: {error}") from None
    if what := ambiguity(map(identity, cells.values())):
        fix = "use one eval_episodes" if ZERO_ACTION in what else "give each its own name in [[trainer]]"
        raise ConfigError(f"{path} has {what}; {fix}")
    return sorted(cells.values(), key=lambda cell: cell.config.seed)


def _line(text: str, part: int, where: list[str]) -> str:
    """The line that holds the first of `where` to be found: in the part itself, else in what all parts share."""
    lines = [line.partition("#")[0] for line in text.splitlines()]
    starts = [k for k, line in enumerate(lines) if re.match(r"\s*(\[\[part\]\]|part\s*=)", line)] or [len(lines)]
    part = min(part, len(starts) - 1)  # parts may also be written as one list
    own = range(starts[part], (*starts, len(lines))[part + 1])
    for word in where:
        for k in (*own, *range(starts[0])):
            if re.search(rf"(?<![\w-]){re.escape(word)}(?![\w-])", lines[k]):
                return f", line {k + 1}"
    return ""


def _grid(data: dict[str, Any]) -> Grid:
    check_names("key", data, [f.name for f in fields(Grid)])
    for name in ("cores", "targets", "arms", "seeds", *data):
        if data.get(name) in (None, [], ""):
            raise GridError(f"the grid has no {name}; give a list", name)
    for name in ("seeds", "members"):
        if name in data:
            data[name] = _numbers(name, data[name])
    _check_types(data)
    for trainer in data.get("trainer", []):
        check_names("key of a trainer", trainer, [f.name for f in fields(Trainer)])
        for name, value in trainer.items():
            if not isinstance(value, kind := dict if name == "set" else str):
                raise GridError(f"{name}={value!r} must be a {'table' if kind is dict else 'name'}", name)
    data["trainer"] = [Trainer(**trainer) for trainer in data.get("trainer", [{}])]
    return Grid(**{name: tuple(value) if isinstance(value, list) else value for name, value in data.items()})


def _numbers(name: str, value: object) -> list[int]:
    if _is_list_of(int, value) and all(number >= 0 for number in value):
        return value
    first, dash, last = str(value).partition("-")
    if not dash or not (first + last).isascii() or not first.isdigit() or not last.isdigit() or int(first) > int(last):
        raise GridError(f'{name}={value!r} must be a list of whole numbers from 0, or "0-9"', name)
    if int(last) - int(first) >= MOST:
        raise GridError(f"{name}={value!r} are more than {MOST:,}; give fewer", name)
    return list(range(int(first), int(last) + 1))


def _check_types(data: Mapping[str, Any]) -> None:
    for name, value in data.items():
        if name in WHOLE and type(value) is not int:
            raise GridError(f"{name}={value!r} must be a whole number", name)
        if name == "seconds" and type(value) not in (int, float):
            raise GridError(f"{name}={value!r} must be a number", name)
        if name in ITEMS and not _is_list_of(ITEMS[name], value):
            raise GridError(f"{name}={value!r} must be a list of {KINDS[ITEMS[name]]}", name)


def _is_list_of(kind: type, value: object) -> TypeGuard[list[Any]]:
    return isinstance(value, list) and all(type(item) is kind for item in value)
