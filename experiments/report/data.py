"""A matrix of runs in memory: the arms of every comparison, by target, trainer and core."""

from __future__ import annotations

import functools
import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np

from experiments.arms import WITHOUT_CORE, WITHOUT_MEMBER, ZERO_ACTION
from experiments.cells import CELL, CELLS, VERSIONS, problems
from experiments.references import best
from experiments.report.runs import Arm, Array
from experiments.rows import ambiguity, ended, label
from experiments.verdict import SCRATCH, TRANSFER, Verdict, judge
from transferkit import stats
from transferkit.errors import RunDirectoryError, UnknownNameError
from transferkit.run.directory import read_json
from transferkit.zoo.card import Card, read_card
from transferkit.zoo.catalog import find_core


@dataclass(frozen=True, eq=False)
class Group:
    """A core on a target under a trainer, with every arm it is compared with."""

    target: str
    trainer: str
    core: str
    arms: Mapping[str, Arm]
    low: float | None
    """Return of the zero action, where it was evaluated."""
    high: float | None
    """Upper reference, where it is known and above the lower one."""
    high_source: str

    @functools.cached_property
    def scores(self) -> dict[str, Array]:
        """Final evaluations `(members, seeds)` of every trained arm over the seeds of all, NaN where a run is missing.

        A run that diverged counts as the worst run of the comparison: else an arm gains by it.
        """
        trained = {name: arm for name, arm in self.arms.items() if name != ZERO_ACTION}
        scores = {name: self.grid(name, "eval_return_mean") for name in trained}
        worst = min(np.nanmin(values, initial=np.inf) for values in scores.values())
        worst = worst if np.isfinite(worst) else np.nan  # no run has finished
        for name, arm in trained.items():
            for row in arm.diverged:
                scores[name][self._place(name, row)] = worst
        return scores

    def grid(self, name: str, measure: str) -> Array:
        """A measure of an arm's runs, as `scores` has it, NaN for failed ones too."""
        values = np.full((len(self._members(name)), len(self._seeds)), np.nan)
        for row in self.arms[name].rows:
            values[self._place(name, row)] = np.nan if row[measure] == "" else row[measure]
        return values

    @functools.cached_property
    def verdict(self) -> Verdict:
        """What the comparison shows."""
        found = judge(self.scores)
        reason = found.reason
        if self.own_task:
            reason += " It was trained on this very task: this shows what training keeps, not transfer."
        counts = {
            "Diverged runs, which count as the worst run of the comparison": lambda arm: len(arm.diverged),
            "Runs that failed in another way, which are left out": lambda arm: len(arm.failed) - len(arm.diverged),
        }
        for what, count in counts.items():
            if names := ", ".join(f"{name} {count(arm)}" for name, arm in self.arms.items() if count(arm)):
                reason += f" {what}: {names}."
        return replace(found, reason=reason)

    @functools.cached_property
    def own_task(self) -> bool:
        """Whether the target is what the core was trained on; False where the core is not here."""
        card = card_of(self.core) if self.core else None
        return card is not None and card.source.env_id == self.target

    @property
    def algo(self) -> str:
        """What trained here."""
        return self._runs[0]["algo"]

    @property
    def scaled(self) -> bool:
        """Whether there are two references to normalise by."""
        return self.low is not None and self.high is not None

    @property
    def normalized_difference(self) -> float | None:
        """Transfer minus scratch, as a share of what lies between the references."""
        difference = self.verdict.scratch
        if difference is None or self.low is None or self.high is None:
            return None
        return difference.mean / (self.high - self.low)

    def normalized(self, returns: Array) -> Array:
        """Returns on the scale from zero action (0) to the upper reference (1)."""
        assert self.low is not None
        assert self.high is not None
        return stats.normalized(returns, self.low, self.high)

    @functools.cached_property
    def _runs(self) -> list[Mapping[str, Any]]:
        return [row for name, arm in self.arms.items() if name != ZERO_ACTION for row in (*arm.rows, *arm.failed)]

    @functools.cached_property
    def _seeds(self) -> list[int]:
        return sorted({row["seed"] for row in self._runs})

    def _members(self, name: str) -> list[int]:
        if name in WITHOUT_MEMBER:
            return [0]
        return sorted({row["member"] for row in self._runs if row["arm"] not in WITHOUT_MEMBER})

    def _place(self, name: str, row: Mapping[str, Any]) -> tuple[int, int]:
        return self._members(name).index(row["member"]), self._seeds.index(row["seed"])


@dataclass(frozen=True)
class Matrix:
    """Everything a report shows."""

    rows: Sequence[Mapping[str, Any]]
    groups: Sequence[Group]
    failed: Sequence[Mapping[str, Any]]
    damaged: Sequence[str]
    commands: Sequence[str]
    versions: Sequence[str]
    """Every set of versions and commit that runs were made with."""


def load_matrix(root: Path) -> Matrix:
    """Read a matrix; damaged cells are named, and stay out of everything else.

    Raises:
        RunDirectoryError: no folder is there, or no finished run in it.
    """
    if not root.is_dir():
        raise RunDirectoryError(f"{root} is no folder; pass one that `python -m experiments.matrix GRID --out DIR` wrote")
    damaged = problems(root)
    finished, failed = ended(root, damaged)
    if not finished:
        but = f" and {len(failed)} failed ones ({failed[0]['error']})" if failed else ""
        raise RunDirectoryError(
            f"{root} holds no finished run{but}; make some with `python -m experiments.matrix GRID --out {root}`"
        )
    rows, lost = ([{**row, "label": label(row)} for row in found] for found in (finished, failed))
    if what := ambiguity(rows + lost):
        fix = "give each a trainer name of its own, or report them from folders of their own"
        raise RunDirectoryError(f"{root} holds {what}; {fix}")
    paths = (root / CELLS / row["id"] / CELL for row in rows)
    commands = sorted({read_json(path)["command"] for path in paths if path.exists()})
    made_by = {tuple(f"{name} {row[name]}" for name in (*VERSIONS, "commit")) for row in rows if row["arm"] != ZERO_ACTION}
    return Matrix(
        rows,
        _groups(rows, lost, root),
        lost,
        [f"{where.name}: {what}" for where, what in damaged.items()],
        commands,
        [", ".join(names) for names in sorted(made_by)],
    )


def card_of(core: str) -> Card | None:
    """The card of a core; None where the core is not here."""
    try:
        return read_card(find_core(core))
    except UnknownNameError:
        return None


def _groups(rows: Sequence[Mapping[str, Any]], failed: Sequence[Mapping[str, Any]], root: Path) -> list[Group]:
    groups = []
    trained, lost = ([row for row in found if row["arm"] != ZERO_ACTION] for found in (rows, failed))
    for target, trainer in sorted({(row["target"], row["label"]) for row in (*trained, *lost)}):
        here, gone = ([row for row in found if (row["target"], row["label"]) == (target, trainer)] for found in (trained, lost))
        idle = [row for row in rows if row["arm"] == ZERO_ACTION and row["target"] == target]
        cores = sorted({row["core"] for row in (*here, *gone) if row["core"]}) or [""]
        low = idle[0]["eval_return_mean"] if idle else None
        reached = [row["eval_return_mean"] for row in rows if row["target"] == target]
        high, source = best(target, max(reached, default=-math.inf))
        high = high if low is not None and high > low else None
        for core in cores:
            own, own_lost = ([row for row in found if row["core"] in ("", core)] for found in (here + idle, gone))
            names = sorted({row["arm"] for row in (*own, *own_lost)}, key=_rank)
            of_arm = lambda found, name: [row for row in found if row["arm"] == name]  # noqa: E731
            arms = {name: Arm(name, of_arm(own, name), root, of_arm(own_lost, name)) for name in names}
            groups.append(Group(target, trainer, core, arms, low, high, source))
    return groups


def _rank(arm: str) -> tuple[int, str]:
    return (0 if arm == TRANSFER else 1 if arm == SCRATCH else 3 if arm in (*WITHOUT_CORE, ZERO_ACTION) else 2, arm)
