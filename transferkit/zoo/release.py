"""Releasing a core: its name, and its folder as a whole."""

from __future__ import annotations

import re
import shutil
from contextlib import suppress
from pathlib import Path
from typing import TYPE_CHECKING

from transferkit.errors import SettingError
from transferkit.files import writing
from transferkit.zoo.artifact import save_core

if TYPE_CHECKING:
    from transferkit.policy.core import Core
    from transferkit.zoo.card import Card

UNFINISHED = ".unfinished"
"""Folder in a zoo in which artifacts are written before they are moved to their place; no zoo lists what is so deep in it."""


def check_name(name: str) -> None:
    """Check the name of a core without its version.

    Raises:
        SettingError: it cannot be the name of a folder everywhere.
    """
    if not re.fullmatch(r"[A-Za-z0-9_-][A-Za-z0-9._-]*", name):
        raise SettingError("name", value=name, allowed="letters, digits, '-', '_' and '.', which is not the first")


def release(core: Core, card: Card, folder: Path) -> Card:
    """Write the artifact and move it to its place as a whole, where half of one would be taken for a released one.

    Raises:
        ArtifactError: the folder exists.
        RunDirectoryError: it cannot be written.
    """
    unfinished = folder.parent / UNFINISHED / folder.name
    shutil.rmtree(unfinished, ignore_errors=True)  # of a call that was killed
    try:
        with writing(folder):
            card = save_core(core, card, unfinished)
            unfinished.rename(folder)
    finally:
        shutil.rmtree(unfinished, ignore_errors=True)
        with suppress(OSError):  # another call writes there, too
            unfinished.parent.rmdir()
    return card
