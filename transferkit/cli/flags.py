"""Flags of the commands that take a whole configuration: tyro's, with errors on one line."""

from __future__ import annotations

import argparse
import io
from collections.abc import Callable, Sequence
from contextlib import redirect_stderr

import tyro

from transferkit.config import PPO_PRESETS, TrainConfig, preset
from transferkit.errors import ConfigError

FRAME = "│|╭╮╰╯ "
RULES = ("─" * 10, "-" * 10)
"""tyro draws its boxes without a frame, in ASCII, where the terminal cannot do better."""


def parse(command: Callable[..., Callable[[], None]], program: str, arguments: Sequence[str]) -> Callable[[], None]:
    """What `command` returns when it is called with the flags.

    Raises:
        ConfigError: an unknown flag, a missing one, or a value of the wrong type.
    """
    messages = io.StringIO()
    try:
        with redirect_stderr(messages):
            return tyro.cli(command, prog=program, args=list(arguments))
    except SystemExit as leaving:
        if not leaving.code:
            raise
        raise ConfigError(f"{_first_message(messages.getvalue())}; `{program} --help` explains the flags") from None


def _first_message(box: str) -> str:
    """The text of tyro's box between its title and its next rule."""
    words: list[str] = []
    for line in box.splitlines()[1:]:
        text = line.strip(FRAME)
        if words and text.startswith((*RULES, "Got errors")):
            break
        if not text.startswith(RULES):
            words += text.split()
    return " ".join(words)


def preset_from(arguments: Sequence[str]) -> TrainConfig:
    """The defaults that the other flags override: those of `--preset`."""
    parser = argparse.ArgumentParser(add_help=False, allow_abbrev=False)
    parser.add_argument("--preset", default="default")
    name = parser.parse_known_args(list(arguments))[0].preset
    if name not in PPO_PRESETS:
        raise ConfigError(f"unknown preset '{name}'; --preset takes {' or '.join(PPO_PRESETS)}")
    return preset(TrainConfig(env=tyro.MISSING), name)
