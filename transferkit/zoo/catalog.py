"""The zoos: the one that is installed with transferkit, folders of your own, and what was pulled from elsewhere."""

from __future__ import annotations

import functools
import logging
import os
from pathlib import Path
from typing import TYPE_CHECKING

import core_zoo
from transferkit.errors import ArtifactError, ConfigError, UnknownNameError
from transferkit.zoo.card import CARD, read_card
from transferkit.zoo.remote.roots import cached_index, pulled_folders, roots

if TYPE_CHECKING:
    from transferkit.zoo.card import Card

ZOO_PATH = "TRANSFERKIT_ZOO"
"""Environment variable with more zoo folders, separated like PATH; they come before the installed zoo."""


def zoo_folders() -> list[Path]:
    """Return the folders whose subfolders are cores."""
    own = [Path(entry) for entry in os.environ.get(ZOO_PATH, "").split(os.pathsep) if entry]
    for folder in own:
        if not os.path.isdir(folder):  # also of a name too long
            _say_missing(folder)
    return [*own, Path(core_zoo.__path__[0]), *pulled_folders()]


@functools.cache
def _say_missing(folder: Path) -> None:
    logging.getLogger("transferkit").warning("%s names %s, which is no folder", ZOO_PATH, folder)


def core_folders() -> dict[str, Path]:
    """Find the folder of every core by id; the first zoo that has an id wins."""
    folders: dict[str, Path] = {}
    for zoo in zoo_folders():
        for card in sorted(zoo.glob(f"*/{CARD}")):
            folders.setdefault(card.parent.name, card.parent)
    return dict(sorted(folders.items()))


def find_core(name: str | Path) -> Path:
    """Find the folder of a core by id or by path.

    Raises:
        ConfigError: a zoo elsewhere has it.
        UnknownNameError: no zoo has it and it is not a folder with a card.
    """
    folders = core_folders()
    if str(name) in folders:
        return folders[str(name)]
    if os.path.exists(Path(name) / CARD):
        return Path(name)
    for root in roots():
        if (index := cached_index(root)) is not None and str(name) in index.cores:
            raise ConfigError(f"core {name} is in the zoo {root.url} and not here", remedy=f"`transferkit zoo pull {name}`")
    raise UnknownNameError("core", str(name), list(folders), topic="cores")


def checked_name(card: Card, name: str) -> Card:
    """A card of the zoo, if it has the name of its folder, by which it is found.

    Raises:
        ArtifactError: it has another.
    """
    if card.id != name:
        raise ArtifactError(f"the folder {name} holds the core {card.id}", remedy=f"call it {card.id}")
    return card


def find_card(name: str | Path) -> Card:
    """Read the card of a core by id or by path.

    Raises:
        UnknownNameError: there is no such core.
        ArtifactError: its card is damaged, tampered with, too new, or has another name than its folder in the zoo.
    """
    card = read_card(find_core(name))
    return checked_name(card, str(name)) if str(name) in core_folders() else card


def list_cards() -> tuple[list[Card], list[ArtifactError]]:
    """Read the card of every core; returns those that can be read, and what is wrong with the others."""
    cards, errors = [], []
    for name, folder in core_folders().items():
        try:
            cards.append(checked_name(read_card(folder), name))
        except ArtifactError as error:
            errors.append(error)
    return cards, errors
