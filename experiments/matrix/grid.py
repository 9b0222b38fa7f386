"""The runs of a grid: a product of lists, each value of it checked."""

from __future__ import annotations

import functools
import itertools
import math
from collections import Counter
from collections.abc import Collection, Iterable, Iterator, Mapping
from contextlib import contextmanager
from dataclasses import dataclass, field, replace
from typing import TYPE_CHECKING

import torch

from experiments.matrix.arms import ARMS, UNTRAINED, WITHOUT_CORE, WITHOUT_MEMBER
from experiments.matrix.cell import Cell
from transferkit.budget import Budget
from transferkit.config import SECTIONS, TrainConfig, check_read, with_settings
from transferkit.envs import derive_spec
from transferkit.errors import ConfigError, SettingError, TransferkitError, UnknownNameError
from transferkit.zoo.artifact import load_core

if TYPE_CHECKING:
    from transferkit.config import Algorithm
    from transferkit.policy.core import Core

MOST = 20_000
"""Combinations of a grid."""

DISTINCT = {"frozen", "padded"}
"""Arms whose sandwiches have other options than the transfer's, so that each can be refused by itself."""


class GridError(ConfigError):
    """A value of a grid that cannot be used."""


@dataclass(frozen=True)
class Trainer:
    """One way to train."""

    algo: Algorithm = "ppo"
    preset: str = "default"
    set: Mapping[str, object] = field(default_factory=dict)
    """Fields of the configuration by dotted name, over the preset; "none" for a field that can be None."""
    name: str = ""
    """In tables; empty for the algorithm, with its preset unless that is `default`."""

    @property
    def label(self) -> str:
        """Its name in tables."""
        return self.name or (self.algo if self.preset == "default" else f"{self.algo} {self.preset}")


@dataclass(frozen=True)
class Grid:
    """The product of its lists."""

    targets: tuple[str, ...]
    arms: tuple[str, ...]
    seeds: tuple[int, ...]
    cores: tuple[str, ...] = ()
    """Needed by arms that have a core."""
    trainer: tuple[Trainer, ...] = (Trainer(),)
    members: tuple[int, ...] = (0,)
    episodes: int | None = None
    steps: int | None = None
    """0 for policies that are evaluated as they begin."""
    seconds: float | None = None
    eval_every: int = 0
    eval_episodes: int = 20
    device: str = "cpu"
    """Torch device of every run's networks, on the machine where it runs."""

    def __post_init__(self) -> None:
        check_names("arm", self.arms, (*ARMS, *WITHOUT_CORE, *UNTRAINED), "arms")
        for key, values in self._lists.items():
            twice = [value for value, count in Counter(values).items() if count > 1]
            if twice:
                remedy = "give each a name" if key == "trainer" else "list it once"
                raise GridError(f"{key}: {twice[0]!r} stands there more than once", remedy=remedy)
        if not self.cores and {*self.arms} & {*ARMS}:
            raise GridError(f"cores: the arms {', '.join(arm for arm in self.arms if arm in ARMS)} need some")
        try:
            torch.device(self.device)
        except RuntimeError:  # whether it is there is for the machine to say on which a run is trained
            raise GridError("device", value=self.device, allowed="a device of torch, such as cpu or cuda") from None
        for target in self.targets:
            with at("targets"):
                derive_spec(target)
        for core, member in itertools.product(self._loaded.values(), self.members):
            with at("members"):
                core.network(member)

    @property
    def _lists(self) -> dict[str, Collection[object]]:
        trainers = [trainer.label for trainer in self.trainer]
        lists = {"cores": self.cores, "members": self.members, "targets": self.targets, "arms": self.arms, "seeds": self.seeds}
        return {**lists, "trainer": trainers}

    @functools.cached_property
    def _loaded(self) -> dict[str, Core]:
        """The cores by name, each loaded once."""
        with at("cores"):
            return {name: load_core(name) for name in self.cores}

    def cells(self) -> list[Cell]:
        """Every run once: arms without a core, or without a member, are not repeated for every one.

        Raises:
            GridError: a setting cannot be used, or a core cannot be built into a target with it.
        """
        found: dict[str, Cell] = {}
        configs = {trainer.label: self._config(trainer) for trainer in self.trainer}
        for config in configs.values():
            self._build(config)
        lists = self.cores or ("",), self.members, self.targets, configs.items(), self.arms, self.seeds
        if math.prod(map(len, lists)) > MOST:
            raise GridError(
                f"the grid has {math.prod(map(len, lists)):,} combinations", remedy=f"at most {MOST:,} fit into one"
            )
        for core, member, target, (name, config), arm, seed in itertools.product(*lists):
            if arm in UNTRAINED:
                cell = Cell(arm, "", "", TrainConfig(target, eval_episodes=self.eval_episodes))
            elif arm in WITHOUT_CORE:
                cell = Cell(arm, "", name, replace(config, env=target, seed=seed))
            else:
                own = 0 if arm in WITHOUT_MEMBER else member
                cell = Cell(arm, core, name, replace(config, env=target, core=core, member=own, seed=seed))
            add(found, cell)
        return list(found.values())

    def _config(self, trainer: Trainer) -> TrainConfig:
        """A trainer's configuration, on the first target."""
        bounds = {"episodes": self.episodes, "steps": self.steps, "seconds": self.seconds}
        if self.steps == 0 and self.episodes is None and self.seconds is None:
            bounds = {}
        else:
            with at("budget"):
                Budget(**bounds)
        settings = _by_dotted_name(trainer.set)
        with at("trainer"):
            config = TrainConfig(
                self.targets[0],
                algo=trainer.algo,
                preset=trainer.preset,
                **bounds,
                eval_every=self.eval_every,
                eval_episodes=self.eval_episodes,
                device=self.device,
            )
            config = with_settings(config, settings)
            check_read(replace(config, core=next(iter(self.cores), None)), settings)
            return config

    def _build(self, config: TrainConfig) -> None:
        """Build every core into every target once for every way in which the arms do it."""
        arms = {"transfer", *DISTINCT & {*self.arms}} if {*self.arms} & {*ARMS} else set()
        for target, arm, (name, core) in itertools.product(self.targets, sorted(arms), self._loaded.items()):
            with at(f"arm {arm} of {name} on {target}"):
                ARMS[arm](replace(config, env=target), core)


def add(found: dict[str, Cell], cell: Cell) -> None:
    """Add a run once.

    Raises:
        GridError: it is there under another trainer's name.
    """
    other = found.setdefault(cell.id, cell).trainer
    if other != cell.trainer:
        raise GridError(f"trainer: {other!r} and {cell.trainer!r} are the same runs", remedy="leave one out")


def check_names(kind: str, names: Iterable[str], known: Collection[str], key: str) -> None:
    """Refuse the first name that is not known."""
    for name in names:
        if name not in known:
            with at(key):
                raise UnknownNameError(kind, name, known)


@contextmanager
def at(key: str) -> Iterator[None]:
    """Make an error inside one of the grid, and name the key, unless the error is of a setting, which names itself."""
    try:
        yield
    except GridError:
        raise
    except TransferkitError as error:
        where = "" if isinstance(error, SettingError) else f"{key}: "
        raise GridError(where + error.worded(in_toml)) from None


def in_toml(name: str, value: str | None) -> str:
    """An option as a grid has it."""
    return name if value is None else f"{name} = {value!r}"


def _by_dotted_name(values: Mapping[str, object]) -> dict[str, object]:
    """Settings by dotted name, quoted in TOML or not."""
    flat: dict[str, object] = {}
    for name, value in values.items():
        if name in SECTIONS and isinstance(value, Mapping):
            flat |= {f"{name}.{key}": own for key, own in value.items()}
        else:
            flat[name] = value
    return flat
