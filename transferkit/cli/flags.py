"""Flags of the commands that take a whole configuration: tyro's, with errors on one line."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, fields, is_dataclass
from typing import TypeVar

import tyro
from tyro import _errors as tyro_errors

from transferkit.config import Algorithm, TrainConfig
from transferkit.errors import ConfigError, UnknownNameError

T = TypeVar("T")


@dataclass(frozen=True)
class _Base:
    """What the defaults of all other flags depend on."""

    algo: Algorithm = "ppo"
    preset: str = "default"


def defaults(arguments: Sequence[str]) -> TrainConfig:
    """Return the configuration that the flags override: the preset of `--algo` and `--preset`."""
    with tyro_errors.on_parse_error(_refuse):
        base, _ = tyro.cli(_Base, args=list(arguments), add_help=False, return_unknown_args=True)
    config = TrainConfig("any", algo=base.algo, preset=base.preset)
    object.__setattr__(config, "env", tyro.MISSING)  # tyro asks for it
    return config


def parse(command: Callable[..., T], program: str, arguments: Sequence[str]) -> T:
    """Return what `command` returns when it is called with the flags.

    Raises:
        ConfigError: a missing flag, or a value of the wrong type.
        UnknownNameError: an unknown flag.
    """
    with tyro_errors.on_parse_error(_refuse):
        return tyro.cli(command, prog=program, args=list(arguments))


def _refuse(event: tyro_errors.ParseErrorEvent) -> None:
    """Raise one line in place of tyro's box; an event of a later tyro falls through to the box."""
    if isinstance(event, tyro_errors.UnrecognizedArgs):
        raise UnknownNameError("flag", event.tokens[0], _known_flags(TrainConfig), topic="flags")
    if isinstance(event, tyro_errors.MissingArgs):
        names = ", ".join(missing.arg.display_name() for missing in event.missing_arguments)
        raise ConfigError(f"missing {names}", topic="flags")
    if isinstance(event, tyro_errors.InvalidChoice):
        name, choices = event.argument.display_name(), " or ".join(event.choices)
        raise ConfigError(name, value=event.value, allowed=choices, topic="flags")
    if isinstance(event, tyro_errors.BadValue):
        given = "" if event.offending_value is None else f" and not {event.offending_value}"
        raise ConfigError(f"{event.argument.display_name()} takes another number of values{given}", topic="flags")
    if isinstance(event, tyro_errors.InstantiationFailure):
        name = event.argument.display_name() if event.argument else event.prog
        raise ConfigError(f"{name}: {' '.join(event.message.split())}", topic="flags")


def _known_flags(kind: type, prefix: str = "--") -> list[str]:
    config, known = TrainConfig("any"), []
    for field in fields(kind):
        section = getattr(config, field.name, None)
        name = field.name.replace("_", "-")
        nested = is_dataclass(section) and not isinstance(section, type)
        known += _known_flags(type(section), f"{prefix}{name}.") if nested else [f"{prefix}{name}"]
    return known
