"""Grids of runs in TOML, checked before anything runs.

```toml
episodes = 200                       # and/or steps, seconds; as in every budget
cores = ["inverted-pendulum-v1"]
members = [0, 1]                     # source seeds of each core, crossed with the seeds
targets = ["InvertedDoublePendulum-v5"]
arms = ["transfer", "scratch", "random"]
seeds = "0-9"                        # or a list
eval_every = 500

[[trainer]]
name = "fast PPO"                    # in tables; by default the algorithm's
algo = "ppo"
preset = "default"
set = { "ppo.learning_rate" = 1e-3 } # any field of the configuration

[[part]]                             # several products in one file: what each has in place of the keys above
targets = ["Hopper-v5"]
seeds = "0-4"
```
"""

from __future__ import annotations

import hashlib
import itertools
import json
import re
import tomllib
from collections import Counter
from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from dataclasses import asdict, dataclass, field, fields, replace
from pathlib import Path
from typing import Any, TypeGuard, get_args

from experiments.arms import ARMS, WITHOUT_CORE, ZERO_ACTION
from transferkit.budget import Budget
from transferkit.config import Algorithm, Preset, TrainConfig, preset
from transferkit.envs import environment_ids
from transferkit.errors import ConfigError, TransferkitError
from transferkit.zoo.artifact import load_core

WHOLE = ("episodes", "steps", "eval_every", "eval_episodes")
ITEMS = {"cores": str, "targets": str, "arms": str, "members": int, "trainer": dict}
KINDS = {str: "names", int: "whole numbers", dict: "tables"}


class GridError(ConfigError):
    """A value of a grid that cannot be."""

    def __init__(self, message: object, *where: object) -> None:
        """`where` is what its line holds, the most telling first; flags that the message names become a grid's keys."""
        super().__init__(re.sub(r"pass --([\w.-]+)", lambda flag: "set " + flag[1].replace("-", "_"), str(message)))
        self.where = [str(word) for word in where]


@dataclass(frozen=True)
class Trainer:
    """One way to train."""

    algo: Algorithm = "ppo"
    preset: Preset = "default"
    set: Mapping[str, Any] = field(default_factory=dict)
    """Fields of the configuration by dotted name, over the preset."""
    name: str = ""
    """In tables; empty for the algorithm's."""


def identify(arm: str, core: str, config: Mapping[str, Any]) -> str:
    """Name of the run with this arm, core and configuration, the same from a `TrainConfig` and from its JSON."""
    data = {"arm": arm, "core": core, "config": _given(config)}
    return hashlib.sha256(json.dumps(data, sort_keys=True).encode()).hexdigest()[:16]


def _given(config: Mapping[str, Any]) -> dict[str, Any]:
    """Without what is None or empty, so that a setting that comes later and is not used leaves names as they are."""
    plain = {name: _given(value) if isinstance(value, Mapping) else value for name, value in config.items()}
    return {name: value for name, value in plain.items() if value is not None and value not in ({}, [], ())}


@dataclass(frozen=True)
class Cell:
    """One run."""

    core: str
    """Empty for arms that have none."""
    member: int
    target: str
    arm: str
    trainer: str
    config: TrainConfig

    @property
    def id(self) -> str:
        """Hash of everything that determines the run."""
        return identify(self.arm, self.core, asdict(self.config))

    @property
    def row(self) -> dict[str, Any]:
        """What tables are grouped by."""
        config = self.config
        names = {"core": self.core, "member": self.member, "target": self.target, "arm": self.arm}
        return names | {"trainer": self.trainer, "algo": config.algo, "preset": config.preset, "seed": config.seed}


@dataclass(frozen=True)
class Grid:
    """The product of its lists."""

    cores: tuple[str, ...]
    targets: tuple[str, ...]
    arms: tuple[str, ...]
    seeds: tuple[int, ...]
    trainer: tuple[Trainer, ...] = (Trainer(),)
    members: tuple[int, ...] = (0,)
    episodes: int | None = None
    steps: int | None = None
    seconds: float | None = None
    eval_every: int = 0
    eval_episodes: int = 20

    def __post_init__(self) -> None:
        with _at("episodes", "steps", "seconds"):
            Budget(self.episodes, self.steps, self.seconds)
        _check_names("arm", self.arms, (*ARMS, *WITHOUT_CORE, ZERO_ACTION))
        _check_names("target", self.targets, environment_ids())
        names = [trainer.name or trainer.algo for trainer in self.trainer]
        for what, values in {
            "core": self.cores,
            "member": self.members,
            "target": self.targets,
            "arm": self.arms,
            "seed": self.seeds,
            "trainer": names,
        }.items():
            _check_distinct(what, values)
        for trainer in self.trainer:
            _check_names("algo", (trainer.algo,), get_args(Algorithm))
            _check_names("preset", (trainer.preset,), get_args(Preset))
        for name in self.cores:
            with _at(name):
                core = load_core(name)
            with _at("members"):
                for member in self.members:
                    core.network(member)

    def cells(self) -> list[Cell]:
        """Every run once: arms without a core are not repeated for every core and member."""
        found: dict[str, Cell] = {}
        lists = self.cores, self.members, self.targets, self.trainer, self.arms, self.seeds
        for core, member, target, trainer, arm, seed in itertools.product(*lists):
            plain = TrainConfig(target, core=core, member=member, algo=trainer.algo, seed=seed)
            config = _override(preset(plain, trainer.preset), trainer.set)
            bounds = {"episodes": self.episodes, "steps": self.steps, "seconds": self.seconds}
            with _at("eval_every", "eval_episodes"):
                config = replace(config, **bounds, eval_every=self.eval_every, eval_episodes=self.eval_episodes)
            cell = Cell(core, member, target, arm, trainer.name or trainer.algo, config)
            if arm in WITHOUT_CORE:
                cell = replace(cell, core="", member=0, config=replace(config, core=None, member=0))
            if arm == ZERO_ACTION:
                cell = Cell("", 0, target, arm, "", TrainConfig(target, eval_episodes=self.eval_episodes))
            found.setdefault(cell.id, cell)
        return list(found.values())


def load_cells(path: Path) -> list[Cell]:
    """Every run of a grid's file, once, seed by seed: what has run at any moment is nearly the same for all arms.

    Raises:
        ConfigError: no such file, no TOML, an unknown key, or a value that cannot be, with its line.
    """
    try:
        text = path.read_text()
        data = tomllib.loads(text)
    except FileNotFoundError:
        raise ConfigError(f"{path} does not exist; grids lie in experiments/grids") from None
    except tomllib.TOMLDecodeError as error:
        raise ConfigError(f"{path} is no TOML: {error}") from None
    parts, cells = data.pop("part", [{}]), {}
    if not _is_list_of(dict, parts):
        raise ConfigError(f"{path}: part={parts!r} must be written as [[part]]")
    for k, part in enumerate(parts):
        try:
            cells |= {cell.id: cell for cell in _grid({**data, **part}).cells()}
        except GridError as error:
            raise ConfigError(f"{path}{_line(text, k, error.where)}: {error}") from None
    return sorted(cells.values(), key=lambda cell: cell.config.seed)


def _line(text: str, part: int, where: list[str]) -> str:
    """The line that holds the first of `where` to be found: in the part itself, else in what all parts share."""
    lines = [line.partition("#")[0] for line in text.splitlines()]
    starts = [k for k, line in enumerate(lines) if line.strip() == "[[part]]"]
    bounds = [0, *starts, len(lines)]
    own = range(*bounds[part + 1 : part + 3]) if starts else ()  # parts may also be written in one line
    for word in where:
        for k in (*own, *range(bounds[1])):
            if re.search(rf"(?<![\w-]){re.escape(word)}(?![\w-])", lines[k]):
                return f", line {k + 1}"
    return ""


@contextmanager
def _at(*where: str) -> Iterator[None]:
    """What is refused inside is a grid's error."""
    try:
        yield
    except TransferkitError as error:
        raise GridError(error, *where) from None


def _grid(data: dict[str, Any]) -> Grid:
    _check_names("key", data, [f.name for f in fields(Grid)])
    for name in ("cores", "targets", "arms", "seeds", *data):
        if data.get(name) in (None, [], ""):
            raise GridError(f"the grid has no {name}; give a list", name)
    data["seeds"] = _seeds(data["seeds"])
    _check_types(data)
    for trainer in data.get("trainer", []):
        _check_names("key of a trainer", trainer, [f.name for f in fields(Trainer)])
        for name, value in trainer.items():
            if not isinstance(value, kind := dict if name == "set" else str):
                raise GridError(f"{name}={value!r} must be a {'table' if kind is dict else 'name'}", name)
    data["trainer"] = [Trainer(**trainer) for trainer in data.get("trainer", [{}])]
    return Grid(**{name: tuple(value) if isinstance(value, list) else value for name, value in data.items()})


def _seeds(value: object) -> list[int]:
    if _is_list_of(int, value):
        return value
    first, dash, last = str(value).partition("-")
    if not dash or not first.isdigit() or not last.isdigit() or int(first) > int(last):
        raise GridError(f'seeds={value!r} must be a list of whole numbers, or "0-9"', "seeds")
    return list(range(int(first), int(last) + 1))


def _override(config: TrainConfig, values: Mapping[str, Any]) -> TrainConfig:
    for name, value in values.items():
        section, _, key = name.partition(".")
        part = getattr(config, section, None)
        if section not in ("ppo", "dyna", "wrap") or not hasattr(part, key):
            raise GridError(f"set has no field {name}; write ppo.FIELD, dyna.FIELD or wrap.FIELD", name, key)
        fixed = tuple(value) if isinstance(value, list) else value
        with _at(name, key):
            try:
                config = replace(config, **{section: replace(part, **{key: fixed})})  # type: ignore[type-var] - a dataclass
            except TypeError:
                raise ConfigError(f"set has {name}={value!r}, which is of the wrong type") from None
    return config


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


def _check_distinct(what: str, values: Any) -> None:  # noqa: ANN401 - any collection of names or numbers
    twice = [value for value, count in Counter(values).items() if count > 1]
    if twice:
        fix = "; give each a name" if what == "trainer" else "; list it once"
        words = [twice[0], "trainer"] if isinstance(twice[0], str) else [f"{what}s"]
        raise GridError(f"the grid has {what} {twice[0]!r} more than once{fix}", *words)


def _check_names(what: str, names: Any, known: Any) -> None:  # noqa: ANN401 - any collections of strings
    for name in names:
        if name not in known:
            shown = ", ".join(list(known)[:20]) + (", ..." if len(known) > 20 else "")
            raise GridError(f"unknown {what} {name!r}; known are {shown}", name)
