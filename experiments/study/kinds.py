"""The kinds of tables in a study's README, each a function of the study and of what the README says about the table."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping, Sequence
from statistics import fmean
from typing import TYPE_CHECKING

from experiments.matrix.arms import UNTRAINED, ZERO_ACTION
from experiments.report.tables import arm_rows, mean_interval
from experiments.report.verdict import SCRATCH, TRANSFER
from experiments.report.verdict import difference as minus
from experiments.study.cells import CELLS, by_member, difference, interval, short, verdict, whole
from experiments.study.rooms import StudyError
from experiments.study.rungs import rungs
from transferkit import stats

if TYPE_CHECKING:
    from experiments.matrix.table import Row
    from experiments.report.comparisons import Group
    from experiments.study.rooms import Study

Lines = list[list[str]]
"""A table: its header, then its rows."""

ARMS = {
    TRANSFER: "core",
    SCRATCH: "scratch",
    "scratch-matched": "scratch, as many parameters",
    "random": "random core",
    "random-matched": "random core, matched",
    "shuffled": "shuffled core",
    "frozen": "core, frozen",
    "frozen-random": "random core, frozen",
    "constant": "constant Gaussian",
    "padded": "core, padded observations",
    "random-action": "random actions",
    ZERO_ACTION: "zero action",
}
"""Arms in the order of tables, and their names there."""


def runs(study: Study, by: Sequence[str], columns: Mapping[str, str], against: Mapping[str, object] | None = None) -> Lines:
    """A line for every combination of the columns `by`; `columns` maps headings to cells, `against` picks the other runs."""
    lines = [[*by, *columns]]
    for key in _keys(study.rows, by):
        own = _select(study.rows, dict(zip(by, key, strict=True)))
        others = _select(study.rows, {"target": own[0].target, **against}) if against else []
        lines.append([*map(_code, by, key), *(CELLS[cell](study, own, others) for cell in columns.values())])
    return lines


def cross(
    study: Study,
    by: Sequence[str],
    columns: Mapping[str, Mapping[str, object]],
    cell: str,
    where: Mapping[str, object] | None = None,
) -> Lines:
    """A line for every combination of the columns `by`, and a cell for every column's selection of its runs.

    `where` narrows all runs. Runs without a core belong to the lines of every core.
    """
    rows, lines = _select(study.rows, where or {}), [[" on ".join(by), *columns]]
    for key in _keys(rows, by):
        own = _select(rows, dict(zip(by, key, strict=True)))
        picked = [_select(own, column) for column in columns.values()]
        lines.append([" on ".join(map(_code, by, key)), *(CELLS[cell](study, each, []) if each else "-" for each in picked)])
    return lines


def arms(study: Study, over: str, columns: Mapping[str, str], between: Sequence[str] = ()) -> Lines:
    """A line for every arm, and two columns for every target or trainer (`over`): the arm, and the core minus it.

    `columns` maps headings to targets or trainers. `between` adds the paired difference of two of them.
    """
    groups = {name: _only(group for group in study.groups if getattr(group, over) == name) for name in columns.values()}
    rows = {name: {str(row["arm"]): row for row in arm_rows(group)} for name, group in groups.items()}
    several = len({row["n"] for own in rows.values() for arm, row in own.items() if arm not in UNTRAINED}) > 1
    lines = [["policy", *(text for heading in columns for text in (heading, "core minus it")), *_heading(columns, between)]]
    for arm, word in ARMS.items():
        if any(arm in own for own in rows.values()):
            cells = [text for name in columns.values() for text in _arm_cells(rows[name].get(arm), several=several)]
            lines.append([word, *cells, *_between(groups, between, arm)])
    verdicts = [text for group in groups.values() for text in (_verdict(group), "")]
    return [*lines, ["verdict", *verdicts, *([""] if between else [])]]


def cores(study: Study, targets: Sequence[str], *, training: bool = False) -> Lines:
    """A line for every target and core: its final evaluation, its differences to scratch and a random core, the verdict.

    The difference to the random core has Holm's correction over the controls that were run. `training` adds the differences
    of the mean of all training episodes.
    """
    more = ["all episodes, minus scratch", "minus random core"] if training else []
    lines = [["target", "core", "core's return", "minus scratch", "minus random core", "verdict", *more]]
    for target in targets:
        for group in (group for group in study.groups if group.target == target and group.core):
            own, random = _arm_cells(arm_rows(group)[0], several=False)[0], group.verdict.controls.get("random")
            cells = [own, difference(group.verdict.scratch), difference(random), _verdict(group)]
            if training:
                cells += [difference(_minus(group, arm, "all_mean")) for arm in (SCRATCH, "random")]
            lines.append([target, f"`{group.core}`", *cells])
    return lines


def untrained(study: Study, pairs: Sequence[Sequence[str]]) -> Lines:
    """A line for each of these pairs of a core and a target, which is never trained: how it is matched, and what it plays.

    How it is matched is from `matches.csv`. Every member's mean stands beside the core's, since members can differ by much.
    """
    matches = {(line["core"], line["target"]): line for line in study.lines("matches")}
    names = ("shuffled", "random", "random-action", ZERO_ACTION)
    lines = [["core on target", "matched", "ranges", "held", "lengths", "core (each member)", *(ARMS[name] for name in names)]]
    for core, target in pairs:
        found, rows = matches[core, target], _select(study.rows, {"core": core, "target": target})
        matched = f"{float(found['inputs']):.0%} and {float(found['actions']):.0%}"
        means = [CELLS["mean"](study, _select(rows, {"arm": name}), []) for name in names]
        own = CELLS["mean, each"](study, _select(rows, {"arm": TRANSFER}), [])
        about = [
            matched,
            f"{float(found['reach']):.0%}" if found["reach"] else "-",
            found["hold"],
            f"{float(found['length']):.2f}",
        ]
        lines.append([f"`{core}` on {short(target)}", *about, own, *means])
    return lines


def kept(study: Study, changes: Mapping[str, str], cores: Sequence[str] = ()) -> Lines:
    """A line for every core, which is never trained: its own score, and what share of it remains where its robot is changed.

    `changes` maps headings to what is added to the robot's id; `cores` are some of them.
    """
    lines = [["core", "own score", *changes, "mean"]]
    for core in cores or sorted({row.core for row in study.rows if row.core}):
        rows = [row for row in study.rows if row.core == core]
        own = min((row.target for row in rows), key=len)
        targets = own, *(f"{own}?{change}" for change in changes.values())
        score, *changed = (fmean(row.eval_return_mean for row in _select(rows, {"target": target})) for target in targets)
        shares = [one / score for one in changed]
        lines.append([f"`{core}`", whole(score), *(f"{share:.2f}" for share in (*shares, fmean(shares)))])
    return lines


def published(study: Study) -> Lines:
    """The paper's measure beside the figures of `published.csv`, whose lines say which runs to take.

    Returns of 0 or less count as -10 in lines that are edited, by the values of `edited.csv`.
    """
    edited = {line["id"]: float(line["last_50_edited"]) for line in study.lines("edited")}
    plain = {row.id: row.last_50_mean for row in study.rows}
    lines = [["", "paper, n 5", "the paper's code, run here", "here"]]
    for line in study.lines("published"):
        own = _select(study.rows, {name: line[name] for name in ("target", "trainer", "arm", "core")})
        scores = by_member(own, edited if line["edited"] else plain)
        low, high = mean_interval(scores)
        assert low is not None
        assert high is not None
        here = f"{interval(float(scores.mean()), low, high)}, n {scores.size}"
        lines.append([line["label"], line["paper"], line["code"] or "-", here])
    return lines


KINDS: Mapping[str, Callable[..., Lines]] = {
    "runs": runs,
    "cross": cross,
    "arms": arms,
    "cores": cores,
    "untrained": untrained,
    "kept": kept,
    "rungs": rungs,
    "published": published,
}


def _keys(rows: Iterable[Row], by: Sequence[str]) -> list[tuple[str, ...]]:
    """Every combination of these columns that was trained, sorted."""
    return sorted({tuple(str(getattr(row, name)) for name in by) for row in rows if row.arm not in UNTRAINED})


def _select(rows: Iterable[Row], picked: Mapping[str, object]) -> list[Row]:
    """The runs with these values, or with one of a list; runs without a core belong to every core."""
    wanted = {name: value if isinstance(value, list) else [value] for name, value in picked.items()}
    return [
        row
        for row in rows
        if all(getattr(row, name) in values or (name == "core" and not row.core) for name, values in wanted.items())
    ]


def _only(groups: Iterable[Group]) -> Group:
    found = list(groups)
    if len(found) != 1:
        raise StudyError(f"a column of this table stands for {len(found)} comparisons; it must be one")
    return found[0]


def _code(column: str, value: str) -> str:
    return f"`{value}`" if column == "core" else value


def _arm_cells(row: Mapping[str, object] | None, *, several: bool) -> tuple[str, str]:
    """Mean of an arm, and the core minus it; `several` adds the number of runs."""
    if row is None:
        return "-", "-"
    mean, low, high, found, found_low, found_high = (
        row[name] for name in ("mean", "mean_low", "mean_high", "difference", "difference_low", "difference_high")
    )
    assert isinstance(mean, float)
    if not isinstance(low, float) or not isinstance(high, float):
        return whole(mean), "-"
    own = interval(mean, low, high) + (f", n {row['n']}" if several else "")
    if isinstance(found, float) and isinstance(found_low, float) and isinstance(found_high, float):
        return own, interval(found, found_low, found_high)
    return own, "-"


def _heading(columns: Mapping[str, str], between: Sequence[str]) -> list[str]:
    words = {name: heading for heading, name in columns.items()}
    return [" minus ".join(words[name] for name in between)] if between else []


def _between(groups: Mapping[str, Group], names: Sequence[str], arm: str) -> list[str]:
    if not names:
        return []
    scores = [groups[name].scores[arm] for name in names if arm in groups[name].scores]
    return [difference(stats.paired_difference(*scores)) if len(scores) == 2 else "-"]


def _minus(group: Group, arm: str, measure: str) -> stats.Difference | None:
    """The core minus an arm in one measure of their runs, without correction."""
    return minus({name: group.grid(name, measure) for name in (TRANSFER, arm)}, arm)


def _verdict(group: Group) -> str:
    said = verdict(group, bold=True)
    return f"{said}, own task" if group.own_task else said
