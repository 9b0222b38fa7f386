"""Errors that a user can cause or must hear of.

An error carries fields: *what* is wrong, with which *value*, what is *allowed*, and the *remedy*. Python shows them in one
line; the command line and the grids of `experiments` word the same fields in their own terms. No code parses a message.
"""

from __future__ import annotations

import difflib
import re
from collections.abc import Callable, Collection, Iterable
from typing import Any

_OPTION = re.compile(r"\{([\w.]+)(?:=([^}]*))?\}")
NOT_GIVEN = ...
"""The error has no value."""

FEW = 12
"""Known names that are listed if none is near."""

LONGEST, LONGEST_VALUE = 1000, 100
"""Characters of a message's parts, and of a value in it, that are shown."""

Spelling = Callable[[str, str | None], str]
"""Writes an option, by its dotted name and perhaps a value, as the reader would write it."""


def in_python(name: str, value: str | None) -> str:
    """An option as a keyword argument."""
    return name if value is None else f"{name}={value}"


def printable(text: str, longest: int | None = None) -> str:
    """Text from a file as a terminal may show it: what is no letter, digit, sign or space is escaped."""
    if longest is not None and len(text) > longest:
        text = f"{text[:longest]}..."
    return text if text.isprintable() else "".join(c if c.isprintable() else ascii(c)[1:-1] for c in text)


def did_you_mean(name: str, known: Iterable[str]) -> str:
    """A question with the nearest known names; empty if none is near."""
    close = difflib.get_close_matches(name, list(known), n=3, cutoff=0.5)
    return f"did you mean {' or '.join(close)}?" if close else ""


def reason_of(error: BaseException, most: int = 200) -> str:
    """What somebody else's exception says, in one line; its kind if it says nothing."""
    return " ".join(str(error).split())[:most] or type(error).__name__


class TransferkitError(Exception):
    """Base of every error that is worth one line instead of a traceback."""

    def __init__(self, what: str, *, value: object = NOT_GIVEN, allowed: str = "", remedy: str = "", topic: str = "") -> None:
        """Take the fields of the message.

        Args:
            what: the thing that is wrong, or a sentence about it.
            value: the value that it has.
            allowed: what it must be: the end of "must be ...".
            remedy: how to mend it; options stand in braces, `{out}` or `{resume=True}`, and are spelled by the front end.
            topic: what a front end may know more about, such as `cores` or `installation`.
        """
        super().__init__(what)
        self.what, self.value, self.allowed, self.remedy, self.topic = what, value, allowed, remedy, topic

    def __str__(self) -> str:
        return self.worded(in_python)

    def worded(self, spell: Spelling, *more: str) -> str:
        """One line, with options as `spell` writes them, followed by `more` that the front end knows."""
        remedy = _OPTION.sub(lambda match: spell(match[1], match[2]), self.remedy)
        problem = printable(self._problem(spell), LONGEST)
        return "; ".join(filter(None, (problem, printable(remedy, LONGEST), *more))).replace("?; ", "? ")

    def _problem(self, spell: Spelling) -> str:
        what = _OPTION.sub(lambda match: spell(match[1], match[2]), self.what)
        given = what if self.value is NOT_GIVEN else f"{what}={printable(repr(self.value), LONGEST_VALUE)}"
        return f"{given} must be {self.allowed}" if self.allowed else given

    def __reduce__(self) -> tuple[Any, ...]:  # exceptions cross processes by pickle
        return _restored, (type(self), self.__dict__)


def _restored(kind: type[TransferkitError], fields: dict[str, Any]) -> TransferkitError:
    error = kind.__new__(kind, fields["what"])
    error.__dict__.update(fields)
    return error


class ConfigError(TransferkitError):
    """A configuration value out of its range, or one that contradicts another."""


class SettingError(ConfigError):
    """A setting with a value that it cannot have; `what` is its dotted name."""

    def _problem(self, spell: Spelling) -> str:
        return f"{spell(self.what, None)}={printable(repr(self.value), LONGEST_VALUE)} must be {self.allowed}"


class UnknownNameError(TransferkitError):
    """A name that no environment, core or option carries; `value` is the name, `known` are those there are."""

    def __init__(self, kind: str, name: str, known: Collection[str], *, topic: str = "") -> None:
        super().__init__(f"unknown {kind}", value=name, topic=topic)
        self.known = tuple(known)

    def _problem(self, spell: Spelling) -> str:
        del spell
        few = f"known are {', '.join(self.known)}" if len(self.known) <= FEW else ""
        return "; ".join(filter(None, (f"{self.what} '{self.value}'", did_you_mean(str(self.value), self.known) or few)))


class EnvironmentContractError(TransferkitError):
    """An environment that cannot be trained on, or that broke its contract while it ran."""


class NotFiniteError(TransferkitError):
    """NaN or infinity from an environment or in a loss."""


class DivergedError(TransferkitError):
    """A training run whose values grew beyond what its rewards allow."""


class ArtifactError(TransferkitError):
    """A core artifact that is damaged, tampered with, too new, or below its threshold."""


class RemoteError(TransferkitError):
    """A zoo elsewhere that cannot be reached, or that does not send what it said."""


class DimensionError(TransferkitError):
    """Two sides whose dimensions do not fit."""


class RunDirectoryError(TransferkitError):
    """A run directory that is in use, missing, damaged, or made with another configuration."""


class RunInUseError(RunDirectoryError):
    """A run directory that another process is writing, or is still saving."""


class RecordingError(TransferkitError):
    """A recording that is not an MCAP file, lacks what is asked of it, or does not fit the environment."""


class InterruptedRunError(TransferkitError):
    """Ctrl-C or SIGTERM: the state is on disk, and the message says how to go on."""
