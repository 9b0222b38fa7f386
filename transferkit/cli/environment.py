"""The flags of an environment: its id, keyword arguments, and what is varied."""

from __future__ import annotations

import argparse
from collections.abc import Callable, Sequence

from transferkit.env_id import EnvId
from transferkit.errors import ConfigError
from transferkit.variation import NAMES, Variation

KWARGS = "keyword arguments of the environment; `--env 'ENV?NAME=VALUE'` is the same"
VARY = (
    f"changes of the robot, such as mass=1.3 length.thigh=0.8 friction=0.5..1.5 delay=2: {', '.join(NAMES)}; a range is drawn "
    "anew in every episode"
)
LISTS = ("--env-kwargs", "--vary")
"""Flags that take several words, and may be given several times."""


def add_environment(flags: argparse.ArgumentParser, help_text: str, *, name: str = "--env") -> None:
    """Add the flags, or the argument `name` with the other flags."""
    flags.add_argument(name, metavar="ENV", help=f"{help_text}: an id, MODULE:ID or MODULE:FUNCTION")
    flags.add_argument("--env-kwargs", nargs="+", action="extend", default=[], metavar="NAME=VALUE", help=KWARGS)
    flags.add_argument("--vary", nargs="+", action="extend", default=[], metavar="NAME=VALUE", help=VARY)


def environment(options: argparse.Namespace, home: Callable[[], str] | None = None) -> str | None:
    """What the flags say; arguments alone are of the environment that `home` knows.

    Raises:
        ConfigError: arguments without an environment, or one that is none.
    """
    if not (options.env_kwargs or options.vary):
        return options.env
    env = options.env if options.env is not None or home is None else home()
    if env is None:
        raise ConfigError("{env_kwargs} and {vary} are of an environment", remedy="give {env} too", topic="environments")
    return with_arguments(env, options.env_kwargs, options.vary)


def with_arguments(env: str, kwargs: Sequence[str], vary: Sequence[str]) -> str:
    """An environment in writing with more arguments, if there are any.

    Raises:
        ConfigError: an argument is none.
    """
    if not (kwargs or vary):
        return env
    given = EnvId.read(env).with_arguments(kwargs, vary)
    Variation.read(given.variation)  # a slip is said before anything heavy is imported
    return str(given)


def gathered(arguments: Sequence[str]) -> list[str]:
    """Arguments with all words of a list flag behind its first occurrence; tyro takes the last one only."""
    words: dict[str, list[str]] = {name: [] for name in LISTS}
    rest, within = [], None
    for word in arguments:
        name, equals, value = word.partition("=")
        if word.startswith("--"):
            within = name if name in LISTS else None
        if within is None:
            rest.append(word)
        else:
            words[within] += [value] if equals and name in LISTS else [word] if word != within else []
    return [*rest, *(word for name, given in words.items() if given for word in (name, *given))]
