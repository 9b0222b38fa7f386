"""Errors in the command line's own words: options as flags, and the command that tells more."""

from __future__ import annotations

import shlex

from transferkit.errors import TransferkitError, printable

MORE = {
    "commands": "`transferkit --help` lists the commands",
    "cores": "`transferkit zoo list` lists the cores",
    "environments": "`transferkit envs list` lists the environments; one that a module registers is MODULE:ID",
    "flags": "`--help` explains the flags",
    "installation": "`transferkit doctor` checks the installation",
    "mappings": "docs/recordings.md has an example",
    "matches": "`transferkit match CORE ENV` shows one",
    "own environments": "docs/own_environment.md says what one may be and must do",
    "recordings": "`transferkit record` makes recordings",
    "variations": "docs/own_environment.md lists the variations",
    "verification": "`transferkit zoo verify ID` checks a core",
}
"""What the command line knows more about the topic of an error."""


def flag(name: str, value: str | None) -> str:
    """Write an option as a flag: `--ppo.gamma`, `--resume`, `--algo dyna-ddpg`, `--dyna.no-mix-batches`."""
    section, dot, key = name.replace("_", "-").rpartition(".")
    if value == "False":
        return f"--{section}{dot}no-{key}"
    shown = "" if value is None or value == "True" else f" {shlex.quote(value) if set(value) & set('&?;<>|') else value}"
    return f"--{section}{dot}{key}{shown}"


def worded(error: Exception) -> str:
    """Put an error into one line."""
    if not isinstance(error, TransferkitError):
        parts = (error.filename, error.strerror) if isinstance(error, OSError) and error.strerror else (error,)
        return printable(": ".join(str(part) for part in parts if part))
    return error.worded(flag, MORE.get(error.topic, ""))
