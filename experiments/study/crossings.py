"""What the cores of the installed zoo do untrained elsewhere, from the rows of a study, for `transferkit zoo show`."""

from __future__ import annotations

from dataclasses import asdict
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

import core_zoo
from experiments.matrix.arms import ZERO_ACTION
from experiments.report.verdict import TRANSFER
from transferkit.files import write_json
from transferkit.zoo.catalog import find_card
from transferkit.zoo.crossings import CROSSINGS, Crossing, Crossings, read_crossings

if TYPE_CHECKING:
    from collections.abc import Sequence

    from experiments.matrix.table import Row
    from experiments.study.rooms import Study

STUDY = "zero_shot"
PATH = Path(core_zoo.__path__[0]) / CROSSINGS


def write_crossings(study: Study) -> None:
    """Write the zoo's file."""
    write_json(PATH, asdict(crossings_of(study)))


def is_current(study: Study) -> bool:
    """Whether the zoo's file says what the rows say."""
    return read_crossings(PATH.parent) == crossings_of(study)


def crossings_of(study: Study) -> Crossings:
    """Take the mean returns of every core on every target but its own."""
    rows = study.rows
    own = {core: find_card(core).source.env_id for core in {row.core for row in rows if row.core}}
    pairs = sorted({(row.core, row.target) for row in rows if row.arm == TRANSFER and own[row.core] != row.target})
    cores: dict[str, list[Crossing]] = {}
    for core, target in pairs:
        cores.setdefault(core, []).append(crossing(rows, core, target))
    return Crossings(study.folder.name, max(row.eval_episodes for row in rows), cores)


def crossing(rows: Sequence[Row], core: str, target: str) -> Crossing:
    """What every member returns, beside controls: those of this core, and those without one."""
    rows = [row for row in rows if row.target == target and row.core in (core, "")]
    own = sorted((row for row in rows if row.arm == TRANSFER), key=lambda row: row.member)
    arms = {row.arm for row in rows} - {TRANSFER}
    controls = {arm: float(np.mean([row.eval_return_mean for row in rows if row.arm == arm])) for arm in sorted(arms)}
    best = max(controls, key=lambda arm: controls[arm])
    members = tuple(round(row.eval_return_mean, 2) for row in own)
    return Crossing(target, members, round(controls[ZERO_ACTION], 2), best, round(controls[best], 2))
