"""Checks of output paths."""

from __future__ import annotations

from pathlib import Path

from transferkit.errors import ConfigError


def check_new(path: Path, option: str) -> None:
    """Check that a file does not exist but its folder does, before any work is done for it.

    Raises:
        ConfigError: the file exists, or its folder does not.
    """
    if path.exists():
        raise ConfigError(f"{path} exists", remedy=f"choose another {{{option}}}")
    if not path.parent.is_dir():
        raise ConfigError(
            f"cannot write {path}: no folder {path.parent}", remedy=f"choose an {{{option}}} in a folder that exists"
        )
