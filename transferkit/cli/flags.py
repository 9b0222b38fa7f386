"""Flags of the commands that take a whole configuration: tyro's, with errors on one line."""

from __future__ import annotations

import itertools
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, fields, is_dataclass
from functools import partial
from typing import TypeVar

import tyro
from tyro import _errors as tyro_errors

from transferkit.cli.answer import JSON_FLAG, refuse_rest, refuse_unknown
from transferkit.config import Algorithm, TrainConfig
from transferkit.config.checks import unfit
from transferkit.errors import ConfigError, SettingError

T = TypeVar("T")


@dataclass(frozen=True)
class _Base:
    """What the defaults of all other flags depend on."""

    algo: Algorithm = "ppo"
    preset: str = "default"


def defaults(arguments: Sequence[str]) -> TrainConfig:
    """Return the configuration that the flags override: the preset of `--algo` and `--preset`."""
    with tyro_errors.on_parse_error(partial(_refuse, arguments, [])):
        base, _ = tyro.cli(_Base, args=list(arguments), add_help=False, return_unknown_args=True)
    config = TrainConfig("any", algo=base.algo, preset=base.preset)
    object.__setattr__(config, "env", tyro.MISSING)  # tyro asks for it
    return config


def parse(command: Callable[..., T], program: str, arguments: Sequence[str], own: Sequence[str]) -> T:
    """Return what `command` returns when it is called with the flags: those of a configuration, and its own.

    Raises:
        ConfigError: a missing flag, or a value of the wrong type.
        UnknownNameError: an unknown flag.
    """
    given = [_none(word, after) for after, word in zip(("", *arguments), arguments, strict=False)]
    known = ["--help", JSON_FLAG, *(f"--{name}" for name in own), *_flags_of(TrainConfig("any"))]
    with tyro_errors.on_parse_error(partial(_refuse, given, known)):
        return tyro.cli(command, prog=program, args=given)


def settings_in(arguments: Sequence[str]) -> list[str]:
    """Settings that are given as flags, by dotted name: `--ppo.no-shuffle` is `ppo.shuffle`."""
    names = [word.partition("=")[0][2:] for word in arguments if word.startswith("--") and "." in word]
    return [name.replace("-", "_").replace(".no_", ".") for name in names if "." in name]


def _none(word: str, before: str) -> str:
    """Spell a setting's `none` as tyro does."""
    flag, equals, value = word.partition("=")
    alone = word == "none" and before.startswith("--") and "." in before
    return "None" if alone else f"{flag}=None" if equals and value == "none" and "." in flag else word


def _refuse(given: Sequence[str], known: Sequence[str], event: tyro_errors.ParseErrorEvent) -> None:
    """Raise one line in place of tyro's box; an event of a later tyro falls through to the box."""
    if isinstance(event, tyro_errors.UnrecognizedArgs):
        refuse_unknown(event.tokens, known)
        refuse_rest(event.tokens)
    if isinstance(event, tyro_errors.MissingArgs):
        refuse_unknown(event.unrecognized_tokens, known)
        names = ", ".join(missing.arg.display_name() for missing in event.missing_arguments)
        raise ConfigError(f"missing {names}", topic="flags")
    if isinstance(event, tyro_errors.InvalidChoice):
        name, choices = event.argument.display_name(), " or ".join(event.choices)
        raise ConfigError(name, value=event.value, allowed=choices, topic="flags")
    if isinstance(event, tyro_errors.BadValue):
        raise ConfigError(f"{event.argument.display_name()} needs a value", topic="flags")
    if isinstance(event, tyro_errors.InstantiationFailure) and event.argument is not None:
        flag, hint = event.argument.display_name(), event.argument.field.type
        value, name = _value_of(flag, given), flag.removeprefix("--").replace("-", "_")
        raise SettingError(name, value=value, allowed=unfit(value, hint), topic="flags")


def _value_of(flag: str, given: Sequence[str]) -> str:
    """What stands after the last such flag."""
    words = [part for word in given for part in (word.split("=", 1) if word.startswith("--") else [word])]
    start = max((k for k, word in enumerate(words, 1) if word.replace("_", "-") == flag), default=len(words))
    return " ".join(itertools.takewhile(lambda word: not word.startswith("--"), words[start:]))


def _flags_of(config: object, prefix: str = "--") -> list[str]:
    """Flags of a configuration's fields, sections and tables."""
    known = []
    for field in fields(config):  # pyright: ignore[reportArgumentType]
        value, name = getattr(config, field.name), prefix + field.name.replace("_", "-")
        if is_dataclass(value):
            known += _flags_of(value, f"{name}.")
        elif isinstance(value, Mapping) and value:
            known += [f"{name}.{key}" for key in value]
        else:
            known.append(name)
    return known
