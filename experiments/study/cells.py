"""What stands in a cell of a study's table: numbers of some runs, as text."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterable, Mapping, Sequence
from functools import partial
from typing import TYPE_CHECKING

import numpy as np

from experiments.matrix.table import Row
from experiments.report.verdict import FEW, NONE
from experiments.study.rooms import Study
from transferkit import stats

if TYPE_CHECKING:
    from experiments.report.comparisons import Group
    from experiments.report.curves import Array
    from transferkit.stats import Difference

Cell = Callable[[Study, Sequence[Row], Sequence[Row]], str]
"""From a study, the runs of the cell, and the runs that they are compared with, none by default."""


def whole(value: float) -> str:
    """A number without decimals."""
    return f"{round(value):d}"


def short(target: str) -> str:
    """An environment's id without what is the same for a whole suite."""
    return target.removeprefix("dm_control/").removesuffix("-v0")


def interval(mean: float, low: float, high: float) -> str:
    """A number with its interval."""
    return f"{whole(mean)} ({whole(low)} to {whole(high)})"


def difference(found: Difference | None) -> str:
    """A paired difference; a dash if there is none."""
    return "-" if found is None else interval(found.mean, found.low, found.high)


def verdict(group: Group, *, bold: bool = False) -> str:
    """The verdict on a core, and that on these members where it is another."""
    kinds = group.verdict.kind, group.verdict_of_members
    kind, members = (f"**{one}**" if bold and one != NONE else one for one in kinds)
    return kind if members == kind else f"{kind}; of these members {members}"


def by_member(rows: Iterable[Row], values: Mapping[str, float] | None = None) -> Array:
    """Final evaluations `(members, seeds)`, or other values of these runs by id."""
    found = {(row.member, row.seed): row.eval_return_mean if values is None else values[row.id] for row in rows}
    members, seeds = (sorted({key[k] for key in found}) for k in (0, 1))
    return np.array([[found[member, seed] for seed in seeds] for member in members])


def mean(_: Study, rows: Sequence[Row], __: Sequence[Row]) -> str:
    """Mean final evaluation."""
    return whole(float(by_member(rows).mean()))


def mean_interval(_: Study, rows: Sequence[Row], __: Sequence[Row]) -> str:
    """Mean with Student's interval over members and seeds; of one run, over its evaluation episodes."""
    if len(rows) > 1:
        scores = by_member(rows)
        return interval(float(scores.mean()), *stats.crossed_interval(scores))
    (row,) = rows
    assert row.eval_episodes
    low, high = stats.summary_interval(row.eval_return_mean, row.eval_return_std, row.eval_episodes)
    return interval(row.eval_return_mean, low, high)


def iqm_interval(_: Study, rows: Sequence[Row], __: Sequence[Row]) -> str:
    """Interquartile mean with its bootstrap interval; of so few runs that this is but their range, alone."""
    scores = by_member(rows).ravel()
    return whole(stats.iqm(scores)) if len(scores) < FEW else interval(stats.iqm(scores), *stats.iqm_interval(scores))


def each(_: Study, rows: Sequence[Row], __: Sequence[Row]) -> str:
    """Every run's final evaluation, by member and seed."""
    return ", ".join(whole(value) for value in by_member(rows).ravel())


def mean_each(study: Study, rows: Sequence[Row], others: Sequence[Row]) -> str:
    """Mean, and every run in parentheses."""
    return f"{mean(study, rows, others)} ({each(study, rows, others)})"


def minus(_: Study, rows: Sequence[Row], others: Sequence[Row]) -> str:
    """Mean of the paired differences to the runs that these are compared with."""
    return "-" if rows == others else difference(stats.paired_difference(by_member(rows), by_member(others)))


def equal_time(study: Study, rows: Sequence[Row], _: Sequence[Row]) -> str:
    """Interquartile mean of the last evaluations before the fastest run on this target had finished."""
    fastest = min(row.seconds for row in study.rows if row.target == rows[0].target)
    last = [[point["return_mean"] for point in study.curves[row.id] if point["seconds"] <= fastest][-1] for row in rows]
    return whole(stats.iqm(last))


def speed_each(_: Study, rows: Sequence[Row], __: Sequence[Row]) -> str:
    """Every run's forward speed in m/s, by seed; a dash if none is reported."""
    speeds = [row.forward_speed for row in sorted(rows, key=lambda row: row.seed)]
    return "-" if any(map(math.isnan, speeds)) else ", ".join(f"{speed:.1f}" for speed in speeds)


def lowest_after(threshold: float, study: Study, rows: Sequence[Row], _: Sequence[Row]) -> str:
    """The lowest evaluation of any run after its first one that reaches a threshold; a dash if none does."""
    later = []
    for row in rows:
        returns = [point["return_mean"] for point in study.curves.get(row.id, [])]
        first = next((k for k, value in enumerate(returns) if value >= threshold), len(returns))
        later += returns[first:]
    return whole(min(later)) if later else "-"


def budget(_: Study, rows: Sequence[Row], __: Sequence[Row]) -> str:
    """Episodes, steps and seconds that each run may spend."""
    limits = zip(rows[0].budget, ("episodes", "steps", "seconds"), strict=True)
    return ", ".join(f"{limit:,} {unit}" for limit, unit in limits if limit is not None)


def seeds(_: Study, rows: Sequence[Row], __: Sequence[Row]) -> str:
    """First and last seed, and how many runs there are."""
    found = sorted({row.seed for row in rows})
    return f"{found[0]} to {found[-1]} ({len(rows)})"


def seconds(_: Study, rows: Sequence[Row], __: Sequence[Row]) -> str:
    """Mean time of training."""
    return whole(float(np.mean([row.seconds for row in rows])))


def seconds_range(_: Study, rows: Sequence[Row], __: Sequence[Row]) -> str:
    """Least and largest time of training."""
    times = [row.seconds for row in rows]
    return f"{whole(min(times))} to {whole(max(times))}"


CELLS: Mapping[str, Cell] = {
    "mean": mean,
    "mean, interval": mean_interval,
    "mean, each": mean_each,
    "IQM, interval": iqm_interval,
    "each seed": each,
    "minus": minus,
    "at equal time": equal_time,
    "speed, each": speed_each,
    "lowest after 9000": partial(lowest_after, 9000.0),
    "budget": budget,
    "seeds": seeds,
    "seconds": seconds,
    "seconds, range": seconds_range,
}
