"""Releasing a core: its name, and its folder as a whole."""

from __future__ import annotations

import re
import shutil
from collections.abc import Iterable, Sequence
from contextlib import suppress
from dataclasses import asdict
from pathlib import Path
from typing import TYPE_CHECKING, NotRequired, TypedDict, Unpack

import numpy as np

from transferkit import stats
from transferkit.errors import SettingError
from transferkit.files import check_folder, writing
from transferkit.versions import command, versions
from transferkit.zoo.artifact import check_unreleased, components_card, save_core
from transferkit.zoo.card import SCORE_EPISODES, SCORE_SEED, Card, Score, Training

if TYPE_CHECKING:
    from transferkit.budget import Spent
    from transferkit.config import TrainConfig
    from transferkit.policy.core import Core
    from transferkit.zoo.card import ImportedFrom

UNFINISHED = ".unfinished"
"""Folder in a zoo in which artifacts are written before they are moved to their place; no zoo lists what is so deep in it."""


class About(TypedDict):
    """What a maker of cores says of one in its card."""

    description: str
    history: tuple[str, ...]
    licence: NotRequired[str]
    origin: NotRequired[ImportedFrom]


def core_id(name: str, version: int) -> str:
    """The id of a core, `<name>-v<version>`, which is also the name of its folder.

    Raises:
        SettingError: the name cannot be that of a folder everywhere.
    """
    if not re.fullmatch(r"[A-Za-z0-9_][A-Za-z0-9._-]{0,79}", name):
        allowed = "letters, digits, '_', '-' and '.', at most 80, the last two not the first"
        raise SettingError("name", value=name, allowed=allowed)
    return f"{name}-v{version}"


def check_place(folder: Path) -> None:
    """Check that a core can be released in this folder of a zoo, before any work is done for it.

    Raises:
        ArtifactError: the version exists.
        ConfigError: a file is in the zoo's place, or nothing can be written there.
    """
    check_folder(folder.parent, "zoo")
    check_unreleased(folder)


def scored(returns: Sequence[tuple[float, ...]], threshold: float | None) -> Score:
    """What each member returned in the episodes of a card; without a threshold the least of them was enough."""
    members = tuple(float(np.mean(member)) for member in returns)
    low, high = stats.hierarchical_interval(returns)
    threshold = min(members) if threshold is None else threshold
    return Score(float(np.mean(members)), low, high, SCORE_EPISODES, SCORE_SEED, members, threshold)


def new_card(core: Core, score: Score, config: TrainConfig, spent: Iterable[Spent], **about: Unpack[About]) -> Card:
    """The card of a core that this command made."""
    return Card(
        id=core.id,
        source=core.spec,
        components=components_card(core),
        seeds=tuple(core.seeds),
        score=score,
        spent=tuple(Training(**asdict(one)) for one in spent),
        command=command(),
        config=asdict(config),
        versions=versions(),
        files={},
        **about,
    )


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
