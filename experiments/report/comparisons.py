"""Comparisons of arms: those of one target, trainer and core, and the verdict on the core."""

from __future__ import annotations

import functools
import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from operator import attrgetter
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from experiments.matrix.arms import UNTRAINED, WITHOUT_CORE, WITHOUT_MEMBER, ZERO_ACTION
from experiments.report.curves import Arm
from experiments.report.ladder import OTHER, rung_of
from experiments.report.references import best
from experiments.report.verdict import SCRATCH, TRANSFER, difference, judge
from transferkit import stats
from transferkit.errors import UnknownNameError
from transferkit.zoo.card import read_card
from transferkit.zoo.catalog import find_core

if TYPE_CHECKING:
    from experiments.matrix.table import Row
    from experiments.report.curves import Array
    from experiments.report.verdict import Verdict
    from transferkit.stats import Difference
    from transferkit.zoo.card import Card


@dataclass(frozen=True, eq=False)
class Group:
    """A core on a target under a trainer, with every arm it is compared with."""

    target: str
    trainer: str
    core: str
    """Empty if no arm has one."""
    arms: Mapping[str, Arm]
    low: float | None
    """Return of the zero action, if it was evaluated."""
    high: float | None
    """Upper reference, if it is known and above the lower one."""
    high_source: str

    @functools.cached_property
    def scores(self) -> dict[str, Array]:
        """Final evaluations of every trained arm; see `measured`."""
        return self.measured("eval_return_mean")

    @functools.cached_property
    def areas(self) -> dict[str, Array]:
        """Areas under the curves of evaluations of every trained arm; see `measured`."""
        return self.measured("area")

    def measured(self, measure: str) -> dict[str, Array]:
        """A measure of every trained arm, `(members, seeds)` over the seeds of all, NaN if a run is missing.

        A run that diverged counts as the worst run of the comparison: else an arm gains by it.
        """
        trained = {name: arm for name, arm in self.arms.items() if name not in UNTRAINED}
        scores = {name: self.grid(name, measure) for name in trained}
        worst = min(np.nanmin(values, initial=np.inf) for values in scores.values())
        worst = worst if np.isfinite(worst) else np.nan  # no run has finished
        return {name: self.each(name, attrgetter(measure), diverged=worst) for name in trained}

    def grid(self, name: str, measure: str) -> Array:
        """A measure of an arm's runs, shaped as in `scores`, NaN for failed ones too."""
        return self.each(name, attrgetter(measure))

    def each(self, name: str, value: Callable[[Row], float], *, diverged: float = math.nan) -> Array:
        """A value of each of an arm's runs, shaped as in `scores`; NaN for failed ones, and this for diverged ones."""
        values = np.full((len(self._members(name)), len(self._seeds)), np.nan)
        for row in self.arms[name].diverged:
            values[self._place(name, row)] = diverged
        for row in self.arms[name].rows:
            values[self._place(name, row)] = value(row)
        return values

    @functools.cached_property
    def verdict(self) -> Verdict:
        """What the comparison shows."""
        found = judge(self.scores, self.areas, span=self.span, refused=self.refused)
        reason = found.reason
        if self.own_task:
            reason += " It was trained on this very task: this shows what training keeps, not transfer."
        diverged = {name: len(arm.diverged) for name, arm in self.arms.items()}
        others = {name: len(arm.failed) - diverged[name] for name, arm in self.arms.items()}
        for what, counts in (
            ("Diverged runs, which count as the worst run of the comparison", diverged),
            ("Runs that failed in another way, which are left out", others),
        ):
            if names := ", ".join(f"{name} {count}" for name, count in counts.items() if count):
                reason += f" {what}: {names}."
        return replace(found, reason=reason)

    @functools.cached_property
    def verdict_of_members(self) -> str:
        """The verdict on the members as they are, whose means over members are compared: the seeds alone are a sample."""
        ends, areas = ({name: values.mean(axis=0)[None] for name, values in one.items()} for one in (self.scores, self.areas))
        return judge(ends, areas, span=self.span, refused=self.refused).kind

    @functools.cached_property
    def own_task(self) -> bool:
        """Whether the core was trained on the target; False if the core is not here."""
        card = card_of(self.core) if self.core else None
        return card is not None and card.source.env_id == self.target

    @property
    def algo(self) -> str:
        """The algorithm of its trainer."""
        return self._runs[0].algo

    @property
    def scaled(self) -> bool:
        """Whether there are two references to normalise by."""
        return self.low is not None and self.high is not None

    @functools.cached_property
    def gains(self) -> dict[str, Difference | None]:
        """Transfer minus scratch in area, at the start and at the end."""
        return {
            "area": self.verdict.gained,
            "jumpstart": difference(self.measured("first_return_mean"), SCRATCH),
            "end": self.verdict.scratch,
        }

    @functools.cached_property
    def rung(self) -> str:
        """Its place on the ladder."""
        card = card_of(self.core) if self.core else None
        return OTHER if card is None else rung_of(card.source.env_id, self.target)

    @property
    def span(self) -> float | None:
        """What lies between the references."""
        return None if self.low is None or self.high is None else self.high - self.low

    @property
    def refused(self) -> float:
        """Share of the transfer's runs whose core was refused on probation."""
        asked = [row.refused for row in self.arms[TRANSFER].rows if row.refused is not None] if TRANSFER in self.arms else []
        return sum(asked) / len(asked) if asked else 0.0

    def share(self, gain: str) -> float | None:
        """One of the gains as a share of what lies between the references."""
        found = self.gains[gain]
        return None if found is None or self.span is None else found.mean / self.span

    def normalized(self, returns: Array) -> Array:
        """Returns on the scale from zero action (0) to the upper reference (1)."""
        assert self.low is not None
        assert self.high is not None
        return stats.normalized(returns, self.low, self.high)

    @functools.cached_property
    def _runs(self) -> list[Row]:
        return [row for name, arm in self.arms.items() if name not in UNTRAINED for row in (*arm.rows, *arm.failed)]

    @functools.cached_property
    def _seeds(self) -> list[int]:
        return sorted({row.seed for row in self._runs})

    def _members(self, name: str) -> list[int]:
        if name in WITHOUT_MEMBER:
            return [0]
        return sorted({row.member for row in self._runs if row.arm not in WITHOUT_MEMBER})

    def _place(self, name: str, row: Row) -> tuple[int, int]:
        return self._members(name).index(row.member), self._seeds.index(row.seed)


def compare(rows: Sequence[Row], root: Path | None = None) -> list[Group]:
    """Every comparison that these rows hold; `root` is the folder of their cells, for learning curves."""
    trained = [row for row in rows if row.arm not in UNTRAINED]
    groups = []
    for target, trainer in sorted({(row.target, row.trainer) for row in trained}):
        here = [row for row in trained if (row.target, row.trainer) == (target, trainer)]
        idle = [row for row in rows if row.arm in UNTRAINED and row.target == target]
        low, high, source = _references(target, [row for row in rows if row.target == target])
        for core in sorted({row.core for row in here if row.core}) or [""]:
            own = [row for row in here + idle if row.core in ("", core)]
            names = sorted({row.arm for row in own}, key=_rank)
            arms = {name: _arm(name, own, root) for name in names}
            groups.append(Group(target, trainer, core, arms, low, high, source))
    return groups


def card_of(core: str) -> Card | None:
    """The card of a core; None if the core is not here."""
    try:
        return read_card(find_core(core))
    except UnknownNameError:
        return None


def _arm(name: str, rows: Sequence[Row], root: Path | None) -> Arm:
    own = [row for row in rows if row.arm == name]
    return Arm(name, [row for row in own if row.finished], root, [row for row in own if not row.finished])


def _references(target: str, rows: Sequence[Row]) -> tuple[float | None, float | None, str]:
    """Zero action, upper reference and the latter's source."""
    idle = [row.eval_return_mean for row in rows if row.arm == ZERO_ACTION]
    low = idle[0] if idle else None
    high, source = best(target, max((row.eval_return_mean for row in rows if row.finished), default=-math.inf))
    return low, high if low is not None and high > low else None, source


def _rank(arm: str) -> tuple[int, str]:
    return (0 if arm == TRANSFER else 1 if arm == SCRATCH else 3 if arm in (*WITHOUT_CORE, *UNTRAINED) else 2, arm)
