"""Grids of runs in TOML, checked before anything runs; `docs/experiments.md` has one with every key."""

from __future__ import annotations

from collections.abc import Collection, Mapping
from dataclasses import fields
from pathlib import Path
from typing import TYPE_CHECKING, Any, TypeGuard

from experiments.matrix.grid import MOST as MOST_CELLS
from experiments.matrix.grid import Grid, GridError, Trainer, add, at, check_names
from experiments.matrix.table import ambiguity
from transferkit.envs import id_from_file, names_module
from transferkit.errors import ConfigError
from transferkit.reading import FormatError, parse_toml, read_bytes

if TYPE_CHECKING:
    from experiments.matrix.cell import Cell

LARGEST = 2**20
"""Bytes of a grid."""

MOST = 10_000
"""Seeds, or members, of a grid."""

NAMES = ("cores", "targets", "arms")
WHOLE = ("episodes", "steps", "eval_every", "eval_episodes")
NEEDED = ("targets", "arms", "seeds")


def load_cells(path: Path, named: Collection[str] = ()) -> list[Cell]:
    """Every run of a grid's file, once, seed by seed: what has run at any moment is nearly the same for all arms.

    Targets that import a module must be `named`.

    Raises:
        ConfigError: there is no such file, it is not TOML, or a key or its value cannot be used.
    """
    try:
        data = parse_toml(read_bytes(path, LARGEST), dict[str, Any])
    except OSError as error:
        raise ConfigError(f"{path} cannot be read ({error.strerror}); grids lie in experiments/studies") from None
    except FormatError as error:
        raise ConfigError(f"{path}: {error}") from None
    parts, cells = data.pop("part", [{}]), {}
    if not parts or not _is_list(parts, dict):
        raise ConfigError(f"{path}: part={parts!r} must be written as [[part]]")
    for k, part in enumerate(parts, 1):
        try:
            for cell in _grid({**data, **part}, path, named).cells():
                add(cells, cell)
            if len(cells) > MOST_CELLS:
                raise GridError(f"the grid has more than {MOST_CELLS:,} runs", remedy="cut it")
        except GridError as error:
            where = f"{path}, part {k}" if len(parts) > 1 else f"{path}"
            raise ConfigError(f"{where}: {error}") from None
    if what := ambiguity(cell.row for cell in cells.values()):
        raise ConfigError(f"{path} has {what}; give each trainer its own name, and every target one eval_episodes")
    return sorted(cells.values(), key=lambda cell: cell.config.seed)


def _grid(data: dict[str, Any], path: Path, named: Collection[str]) -> Grid:
    check_names("key", data, [f.name for f in fields(Grid)], "grid")
    for name in (*NEEDED, *data):
        if data.get(name) in (None, [], ""):
            raise GridError(f"{name}: the grid has none", remedy="give a list")
    _check_types(data)
    for name in ("seeds", "members"):
        if name in data:
            data[name] = _numbers(name, data[name])
    for target in data["targets"]:
        with at("targets"):
            if names_module(target) and target not in named:
                raise GridError(
                    f"targets: {target} runs a module",
                    remedy="if you trust that, name it to the command as well, as its option env",
                )
            id_from_file(target, path, target)
    trainers = [_trainer(trainer) for trainer in data.pop("trainer", [{}])]
    lists: dict[str, Any] = {name: tuple(value) if isinstance(value, list) else value for name, value in data.items()}
    with at("grid"):
        return Grid(**lists, trainer=tuple(trainers))


def _trainer(data: Mapping[str, Any]) -> Trainer:
    check_names("key", data, [f.name for f in fields(Trainer)], "trainer")
    for name, value in data.items():
        kind, words = (dict, "a table") if name == "set" else (str, "a name")
        if not isinstance(value, kind):
            raise GridError(f"trainer: {name}", value=value, allowed=words)
    return Trainer(**data)


def _numbers(name: str, value: object) -> list[int]:
    if _is_list(value, int) and all(number >= 0 for number in value):
        return value
    first, dash, last = str(value).partition("-")
    if (
        not dash
        or len(first + last) > 18
        or not (first + last).isascii()
        or not first.isdigit()
        or not last.isdigit()
        or int(first) > int(last)
    ):
        raise GridError(name, value=value, allowed='a list of whole numbers from 0, or "0-9"')
    if int(last) - int(first) >= MOST:
        raise GridError(name, value=value, allowed=f"at most {MOST:,}")
    return list(range(int(first), int(last) + 1))


def _check_types(data: Mapping[str, Any]) -> None:
    for name, value in data.items():
        if name in WHOLE and type(value) is not int:
            raise GridError(name, value=value, allowed="a whole number")
        if name == "seconds" and type(value) not in (int, float):
            raise GridError(name, value=value, allowed="a number")
        if name == "device" and not isinstance(value, str):
            raise GridError(name, value=value, allowed="a name")
        if name in NAMES and not _is_list(value, str):
            raise GridError(name, value=value, allowed="a list of names")
        if name == "trainer" and not _is_list(value, dict):
            raise GridError(name, value=value, allowed="a list of tables, each written as [[trainer]]")


def _is_list(value: object, kind: type) -> TypeGuard[list[Any]]:
    return isinstance(value, list) and all(type(item) is kind for item in value)
