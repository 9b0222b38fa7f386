"""What a command answers: data for `--json`, and text for everybody else."""

from __future__ import annotations

import argparse
import contextlib
import itertools
import json
import sys
from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Annotated, Any, NoReturn

from transferkit.config.checks import Range, check_value
from transferkit.errors import ConfigError, UnknownNameError, printable

JSON_FLAG = "--json"


@dataclass(frozen=True)
class Answer:
    """The outcome of a command."""

    data: object
    """Any JSON value."""
    text: str
    code: int = 0
    """Exit status."""

    def show(self, *, as_json: bool) -> None:
        """Print the data or the text on stdout."""
        text = "\n".join(map(printable, self.text.split("\n")))  # some of it may come from a stranger's file
        print(json.dumps(self.data, indent=2, allow_nan=False) if as_json else text)


def where_to_find(folder: Path) -> str:
    """How commands take a core that was just written."""
    return f"commands take it as {folder}, or as {folder.name} where TRANSFERKIT_ZOO names {folder.parent}"


class Parser(argparse.ArgumentParser):
    """A parser that raises what is wrong with the arguments instead of printing its usage."""

    def parse_known_args(  # pyright: ignore[reportIncompatibleMethodOverride] - overloads
        self,
        args: Iterable[str] | None = None,
        namespace: Any = None,  # noqa: ANN401
    ) -> tuple[Any, list[str]]:
        """Parse arguments, all of which must be known.

        Raises:
            UnknownNameError: an unknown flag.
            ConfigError: an argument too few or too many.
        """
        given = list(sys.argv[1:] if args is None else args)
        own = itertools.takewhile(lambda word: word.startswith("-") or not self._subparsers, given)
        everywhere = [JSON_FLAG] if self.prog.startswith("transferkit") else []
        refuse_unknown(itertools.takewhile(lambda word: word != "--", own), [*self._option_string_actions, *everywhere])
        options, rest = super().parse_known_args(given, namespace)
        refuse_rest(rest)
        return options, []

    def error(self, message: str) -> NoReturn:
        """Raise what argparse says."""
        raise ConfigError(message, topic="flags")

    def _check_value(self, action: argparse.Action, value: Any) -> None:  # noqa: ANN401
        if action.choices is not None and value not in action.choices:
            raise UnknownNameError(action.dest, value, list(action.choices), topic="flags")


def parser(command: str, description: str) -> Parser:
    """Make the parser of a command without a whole configuration; `transferkit` itself takes `--json` off its arguments."""
    epilog = f"{JSON_FLAG} prints one JSON value and nothing else on stdout."
    return Parser(f"transferkit {command}", description=description, epilog=epilog)


def whole(name: str, allowed: Range) -> Callable[[str], int]:
    """Make the reader of a flag's whole number."""

    def read(text: str) -> int:
        number: Any = text
        with contextlib.suppress(ValueError):
            number = int(text)
        check_value(name, number, Annotated[int, allowed])
        return number

    return read


def refuse_unknown(words: Iterable[str], known: Sequence[str]) -> None:
    """Refuse the first flag that is not known."""
    for word in words:
        name = word.partition("=")[0]
        if word.startswith("--") and name not in known:
            raise UnknownNameError("flag", name, [flag for flag in known if flag.startswith("--")], topic="flags")


def refuse_rest(words: Sequence[str]) -> None:
    """Refuse arguments that nothing takes."""
    if words:
        raise ConfigError(f"unexpected argument '{words[0]}'", topic="flags")
