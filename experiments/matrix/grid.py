"""The runs of a grid: a product of lists, each value of it checked."""

from __future__ import annotations

import functools
import hashlib
import itertools
import json
import re
from collections import Counter
from collections.abc import Collection, Iterable, Iterator, Mapping
from contextlib import contextmanager
from dataclasses import asdict, dataclass, field, fields, replace
from typing import Any, get_args, get_type_hints

from experiments.matrix.arms import ARMS, WITHOUT_CORE, WITHOUT_MEMBER, ZERO_ACTION
from transferkit.budget import Budget
from transferkit.config import Algorithm, Preset, TrainConfig, preset
from transferkit.envs import derive_spec
from transferkit.errors import ConfigError, TransferkitError, did_you_mean
from transferkit.policy.core import Core
from transferkit.zoo.artifact import load_core

SECTIONS = ("ppo", "dyna", "wrap")
"""Parts of a configuration whose fields a trainer can set."""

DISTINCT = {"frozen", "padded"}
"""Arms whose sandwiches have other options than the transfer's, so that each could be refused by itself."""


class GridError(ConfigError):
    """A value of a grid that cannot be."""

    def __init__(self, message: object, *where: object) -> None:
        """`where` is what its line holds, the most telling first; flags that the message names become a grid's keys."""
        text = re.sub(r"\bpass (?=--)", "set ", str(message))
        key = lambda flag: flag[2].replace("-", "_") + (" false" if flag[1] else "")  # noqa: E731
        super().__init__(re.sub(r"--(no-)?([\w.-]+)", key, text))
        self.where = [str(word) for word in where]


@dataclass(frozen=True)
class Trainer:
    """One way to train."""

    algo: Algorithm = "ppo"
    preset: Preset = "default"
    set: Mapping[str, Any] = field(default_factory=dict)
    """Fields of the configuration by dotted name, over the preset; "none" where a field can be None."""
    name: str = ""
    """In tables; empty for the algorithm's."""


def identify(arm: str, core: str, config: Mapping[str, Any]) -> str:
    """Name of the run with this arm, core and configuration, the same from a `TrainConfig` and from its JSON."""
    data = {"arm": arm, "core": core, "config": _given(config)}
    return hashlib.sha256(json.dumps(data, sort_keys=True).encode()).hexdigest()[:16]


UNCOMPARED = ("env", "core", "member", "seed", "episodes", "steps", "seconds", "eval_every", "checkpoint_seconds", "wrap")
"""What runs under one trainer's name may differ in: the grid's other lists, its budgets, and what changes no result."""


def settings(config: Mapping[str, Any]) -> dict[str, str]:
    """Names of what a trainer sets, and of how it builds a core in, the same from a `TrainConfig` and from its JSON."""
    given = _given(config)
    parts = {"setting": {k: v for k, v in given.items() if k not in UNCOMPARED}, "wrapping": given.get("wrap", {})}
    texts = {name: json.dumps(part, sort_keys=True) for name, part in parts.items()}
    return {name: hashlib.sha256(text.encode()).hexdigest()[:8] for name, text in texts.items()} | (
        {} if config["core"] else {"wrapping": ""}
    )


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
        check_names("arm", self.arms, (*ARMS, *WITHOUT_CORE, ZERO_ACTION))
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
            check_names("algo", (trainer.algo,), get_args(Algorithm))
            check_names("preset", (trainer.preset,), get_args(Preset))
        for name in self.targets:
            with _at(name):
                derive_spec(name)
        for core, member in itertools.product(self._cores.values(), self.members):
            with _at("members"):
                core.network(member)

    @functools.cached_property
    def _cores(self) -> dict[str, Core]:
        """By name, loaded once."""
        found = {}
        for name in self.cores:
            with _at(name):
                found[name] = load_core(name)
        return found

    def cells(self) -> list[Cell]:
        """Every run once: arms without a core, or without a member, are not repeated for every one.

        Raises:
            GridError: a setting cannot be, or a core cannot be built into a target with it.
        """
        found: dict[str, Cell] = {}
        configs = {trainer.name or trainer.algo: self._config(trainer) for trainer in self.trainer}
        for trainer, config in zip(self.trainer, configs.values(), strict=True):
            self._build(config, [key.rpartition(".")[2] for key in trainer.set])
        lists = self.cores, self.members, self.targets, configs.items(), self.arms, self.seeds
        for core, member, target, (name, config), arm, seed in itertools.product(*lists):
            cell = Cell(core, member, target, arm, name, replace(config, env=target, core=core, member=member, seed=seed))
            if arm in WITHOUT_MEMBER:
                cell = replace(cell, member=0, config=replace(cell.config, member=0))
            if arm in WITHOUT_CORE:
                cell = replace(cell, core="", config=replace(cell.config, core=None))
            if arm == ZERO_ACTION:
                cell = Cell("", 0, target, arm, "", TrainConfig(target, eval_episodes=self.eval_episodes))
            add(found, cell)
        return list(found.values())

    def _config(self, trainer: Trainer) -> TrainConfig:
        """A trainer's configuration, on the first target."""
        with _at(trainer.preset, trainer.algo):
            config = preset(TrainConfig(self.targets[0], algo=trainer.algo), trainer.preset)
        config = _override(config, _by_dotted_name(trainer.set))
        bounds = {"episodes": self.episodes, "steps": self.steps, "seconds": self.seconds}
        with _at("eval_every", "eval_episodes"):
            return replace(config, **bounds, eval_every=self.eval_every, eval_episodes=self.eval_episodes)

    def _build(self, config: TrainConfig, changed: Iterable[str]) -> None:
        """Build every core into every target once for every way in which the arms do it."""
        arms = {"transfer", *DISTINCT & {*self.arms}} if {*self.arms} & {*ARMS} else set()
        for target, arm, (name, core) in itertools.product(self.targets, sorted(arms), self._cores.items()):
            with _at(*changed, target, name):
                ARMS[arm](replace(config, env=target), core)


def add(found: dict[str, Cell], cell: Cell) -> None:
    """Add a run once.

    Raises:
        GridError: it is there under another trainer's name.
    """
    other = found.setdefault(cell.id, cell).trainer
    if other != cell.trainer:
        raise GridError(f"trainers {other!r} and {cell.trainer!r} are the same runs; leave one out", cell.trainer)


@contextmanager
def _at(*where: str) -> Iterator[None]:
    """What is refused inside is a grid's error."""
    try:
        yield
    except TransferkitError as error:
        raise GridError(error, *where) from None


def _by_dotted_name(values: Mapping[str, Any]) -> dict[str, Any]:
    """Settings by dotted name, quoted in TOML or not."""
    flat: dict[str, Any] = {}
    for name, value in values.items():
        flat |= (
            {f"{name}.{key}": own for key, own in value.items()}
            if name in SECTIONS and isinstance(value, Mapping)
            else {name: value}
        )
    return flat


def _override(config: TrainConfig, values: Mapping[str, Any]) -> TrainConfig:
    changed: dict[str, dict[str, Any]] = {}
    for name, value in values.items():
        section, _, key = name.partition(".")
        part = getattr(config, section, None)
        kinds = get_type_hints(type(part)) if section in SECTIONS else {}
        if key not in kinds:
            known = [f"{section}.{f.name}" for section in SECTIONS for f in fields(getattr(config, section))]
            raise GridError(
                f"set has no field {name}; {did_you_mean(name, known)}write ppo.FIELD, dyna.FIELD or wrap.FIELD", name, key
            )
        fixed = tuple(value) if isinstance(value, list) else value
        if value == "none" and type(None) in get_args(kinds[key]):
            fixed = None
        with _at(name, key):
            if not (fixed is None or _fits(fixed, getattr(part, key))):
                raise ConfigError(f"set has {name}={value!r}, which is of another type than {getattr(part, key)!r}")
        changed.setdefault(section, {})[key] = fixed
    for section, own in changed.items():  # at once: one setting may need another
        with _at(*own):
            config = replace(config, **{section: replace(getattr(config, section), **own)})
    return config


def _fits(value: object, default: object) -> bool:
    """Whether a value can stand for a field's default; what can be None is a number."""
    if default is None or isinstance(default, float):
        return type(value) in (int, float)
    if isinstance(default, tuple):
        return isinstance(value, tuple) and all(type(item) is type(default[0]) for item in value)
    return isinstance(value, Mapping) if isinstance(default, Mapping) else type(value) is type(default)


def _check_distinct(what: str, values: Any) -> None:  # noqa: ANN401 - any collection of names or numbers
    twice = [value for value, count in Counter(values).items() if count > 1]
    if twice:
        fix = "; give each a name" if what == "trainer" else "; list it once"
        words = [twice[0], "trainer"] if isinstance(twice[0], str) else [f"{what}s"]
        raise GridError(f"the grid has {what} {twice[0]!r} more than once{fix}", *words)


def check_names(what: str, names: Iterable[str], known: Collection[str]) -> None:
    """Refuse the first name that is not known."""
    for name in names:
        if name not in known:
            raise GridError(f"unknown {what} {name!r}; {did_you_mean(name, known)}known are {', '.join(known)}", name)
