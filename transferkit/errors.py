"""The errors a user can cause or must hear of: one line each, saying what is wrong and what fixes it."""

from __future__ import annotations

import difflib
from collections.abc import Iterable


def did_you_mean(name: str, known: Iterable[str]) -> str:
    """A question with the nearest of the known names and a space, for the middle of a message; empty where none is near."""
    close = difflib.get_close_matches(name, list(known), n=3, cutoff=0.5)
    return f"did you mean {' or '.join(close)}? " if close else ""


class TransferkitError(Exception):
    """Base of every error that the command line prints as one line with exit code 2."""


class UnknownNameError(TransferkitError):
    """A name that no environment, core or option carries."""

    def __init__(self, kind: str, name: str, known: Iterable[str], listing: str) -> None:
        super().__init__(f"unknown {kind} '{name}'; {did_you_mean(name, known)}`{listing}` lists them")


class EnvironmentContractError(TransferkitError):
    """An environment that transferkit cannot train on, or that broke its contract while running."""


class NotFiniteError(TransferkitError):
    """NaN or infinity from an environment or in a loss."""


class DivergedError(TransferkitError):
    """A training whose values grew beyond what the rewards allow."""


class ArtifactError(TransferkitError):
    """A core artifact that is damaged, tampered with, too new, or below its threshold."""


class DimensionError(TransferkitError):
    """Two sides whose dimensions do not fit."""


class ConfigError(TransferkitError):
    """A configuration value out of its range, or one that contradicts another."""


class RunDirectoryError(TransferkitError):
    """A run directory that is in use, missing, damaged, or made with another configuration."""


class RunInUseError(RunDirectoryError):
    """Another process is writing the run directory, or is still saving it."""


class Interrupted(TransferkitError):  # noqa: N818 - not a fault
    """Ctrl-C or SIGTERM: the state is on disk and the message says how to resume."""


class RecordingError(TransferkitError):
    """A recording that is no MCAP file, lacks what is asked of it, or does not fit the environment."""
