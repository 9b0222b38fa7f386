"""The streams, arguments and surroundings that a program is started with, made fit for what it prints."""

from __future__ import annotations

import contextlib
import io
import logging
import os
import sys
from collections.abc import Sequence

from transferkit.errors import ConfigError, printable

NARROWEST = 40
"""Columns below which the layout of a help page takes for ever."""


def mend_surroundings() -> None:
    """Open closed streams (`>&-`), so that no file gets their number; write what the locale cannot; warn in plain words."""
    for number, name in enumerate(("stdin", "stdout", "stderr")):
        if getattr(sys, name) is None:
            os.dup2(os.open(os.devnull, os.O_RDWR), number)
            os.set_inheritable(number, True)
            setattr(sys, name, open(number, "w" if number else "r"))  # noqa: SIM115 - until the end
    if isinstance(sys.stdout, io.TextIOWrapper):
        sys.stdout.reconfigure(errors="backslashreplace")
    logging.basicConfig(format="%(message)s")  # before dm_control's absl does, with a prefix
    logging.getLogger("transferkit").addFilter(_escape)
    os.environ["MPLBACKEND"] = "Agg"  # matplotlib cannot be imported if it names none
    if os.environ.get("COLUMNS", "").isdigit() and int(os.environ["COLUMNS"]) < NARROWEST:
        os.environ["COLUMNS"] = str(NARROWEST)


def check_readable(arguments: Sequence[str]) -> None:
    """Refuse arguments that are no text in this locale.

    Raises:
        ConfigError: there is one.
    """
    for argument in arguments:
        if not argument.isascii() and argument.encode(errors="replace").decode() != argument:
            raise ConfigError(f"this locale cannot read the argument {argument!r}", remedy="set PYTHONUTF8=1, or use ASCII")


def drop_output(code: int) -> int:
    """Let Python flush what is left of the output, which cannot be written, into nothing."""
    with contextlib.suppress(OSError, ValueError):
        os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())
    return code


def _escape(record: logging.LogRecord) -> bool:
    """Write what a warning quotes of a stranger's file as a terminal may show it."""
    record.msg, record.args = printable(record.getMessage()), ()
    return True
