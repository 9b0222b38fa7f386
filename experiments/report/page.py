"""The page: one HTML file that needs no network."""

from __future__ import annotations

import base64
import json
import math
from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any

import jinja2
from plotly.offline import get_plotlyjs

from experiments.matrix.arms import UNTRAINED
from experiments.report.curves import AXES, KINDS
from experiments.report.tables import aggregate_rows, arm_rows, curve_rows, paper_rows, verdict_rows
from experiments.report.verdict import HARMFUL, NONE, POSITIVE, REFUSED
from transferkit.files import write_atomically

if TYPE_CHECKING:
    from experiments.matrix.table import Row
    from experiments.report.comparisons import Group
    from experiments.report.curves import Arm
    from experiments.report.matrix import Matrix

GAINS = ("area", "jumpstart", "end")
"""What can be drawn as a map."""

TEMPLATE = Path(__file__).with_name("page.html.j2")
SIGNS = {POSITIVE: "+", HARMFUL: "-", REFUSED: "⊘", NONE: "○"}
"""Beside the colour, for those who do not see it."""


def write_page(matrix: Matrix, pictures: Sequence[Path], tables: Sequence[Path], out: Path) -> None:
    """Write the page."""
    environment = jinja2.Environment(autoescape=True, undefined=jinja2.StrictUndefined, trim_blocks=True, lstrip_blocks=True)
    environment.filters |= {"num": number, "sign": sign, "found": difference, "supported": supported, "ends": ends}
    ids = {id(group): f"cell-{k}" for k, group in enumerate(matrix.groups)}
    curves: dict[str, Any] = {}
    page = environment.from_string(TEMPLATE.read_text()).render(
        matrix=matrix,
        ids=ids,
        id=id,
        arm_rows=arm_rows,
        curve_rows=curve_rows,
        aggregates=aggregate_rows(matrix.groups),
        paper=paper_rows(matrix.groups),
        verdicts=[
            (ids[id(group)], sign(group), next((line["data_efficiency"] for line in curve_rows(group)), None), row)
            for group, row in zip((g for g in matrix.groups if g.core), verdict_rows(matrix.groups), strict=True)
        ],
        gains=list(GAINS),
        heat=[heat_map(matrix, trainer, ids) for trainer in dict.fromkeys(g.trainer for g in matrix.groups if g.core)],
        cells={ids[id(group)]: cell_data(group, curves) for group in matrix.groups},
        curves=curves,
        kinds=KINDS,
        pictures=[(path.stem, base64.b64encode(path.read_bytes()).decode()) for path in pictures],
        tables=[path.name for path in tables],
        budgets=sorted({budget(row) for row in matrix.rows if row.arm not in UNTRAINED}),
        plotly=get_plotlyjs(),
        dumps=dumps,
    )
    write_atomically(out, page.encode())


def heat_map(matrix: Matrix, trainer: str, ids: dict[int, str]) -> dict[str, Any]:
    """Transfer minus scratch of every core and target under a trainer, as plotly's heat map wants it, for each of the gains."""
    groups = {(group.core, group.target): group for group in matrix.groups if group.trainer == trainer and group.core}
    cores, targets = (list(dict.fromkeys(key[k] for key in groups)) for k in (0, 1))
    grid = [[groups.get((core, target)) for target in targets] for core in cores]
    return {
        "trainer": trainer,
        "x": targets,
        "y": cores,
        "scaled": any(group.scaled for group in groups.values()),
        "maps": {
            gain: {
                "z": [[group and (group.share(gain) or 0.0) for group in row] for row in grid],
                "text": [["" if group is None else _heat_text(group, gain) for group in row] for row in grid],
            }
            for gain in GAINS
            if any(group.gains[gain] for group in groups.values())
        },
        "words": [["" if group is None else group.verdict.kind for group in row] for row in grid],
        "cells": [[group and ids[id(group)] for group in row] for row in grid],
    }


def _heat_text(group: Group, gain: str) -> str:
    found = group.gains[gain]
    return sign(group) + ("" if found is None else f"<br>{difference(found.mean, found.low, found.high)}")


def sign(group: Group) -> str:
    """The sign of its verdict; in parentheses if the target is the core's own task."""
    return f"({SIGNS[group.verdict.kind]})" if group.own_task else SIGNS[group.verdict.kind]


def cell_data(group: Group, curves: dict[str, Any]) -> dict[str, Any]:
    """What a cell's figures need; curves that cells share are stored once."""
    arms = []
    for name, arm in group.arms.items():
        key = f"{group.trainer}|{group.target}|{name}|{min(row.core for row in (*arm.rows, *arm.failed))}"
        if key not in curves:
            curves[key] = (
                {} if name in UNTRAINED else {f"{kind}|{axis}": _curve(arm, kind, axis) for kind in KINDS for axis in AXES}
            )
        seeds = [[f"member {row.member}, seed {row.seed}", _short(row.eval_return_mean)] for row in arm.rows]
        arms.append({"name": name, "curve": key, "seeds": seeds})
    return {"arms": arms}


def _curve(arm: Arm, kind: str, axis: str) -> list[list[float]] | None:
    curve = arm.curve(kind, axis)
    if curve is None:
        return None
    return [[_short(value) for value in line] for line in (curve.x, curve.middle, curve.low, curve.high)]


def budget(row: Row) -> str:
    """What a run may spend."""
    limits = zip(row.budget, ("episodes", "steps", "seconds"), strict=True)
    bounds = " and ".join(f"{limit} {unit}" for limit, unit in limits if limit is not None) or "no training"
    return f"{row.target}, {row.trainer}: {bounds}, then {row.eval_episodes} episodes of evaluation"


def difference(mean: float | None, low: float | None, high: float | None) -> str:
    """A difference, with its sign; empty without an interval."""
    return "" if mean is None or low is None or high is None else _rounded(mean, low, high, "+")


def supported(value: float | None, low: float | None, high: float | None) -> str:
    """A number with the digits that its interval supports."""
    return number(value) if value is None or low is None or high is None else _rounded(value, low, high)


def ends(low: float | None, high: float | None) -> str:
    """An interval; empty if there is none."""
    return "" if low is None or high is None else f"{_rounded(low, low, high)} to {_rounded(high, low, high)}"


def _rounded(value: float, low: float, high: float, sign: str = "") -> str:
    """A number to two digits of half the width of its interval; one that is not 0 never becomes 0."""
    half = (high - low) / 2
    if not math.isfinite(half) or half <= 0 or not math.isfinite(value):
        return (sign if value > 0 else "") + number(value)
    decimals = 1 - math.floor(math.log10(half))
    rounded = round(value, decimals)
    return f"{value:{sign}.1g}" if value and not rounded else f"{rounded:{sign}.{max(decimals, 0)}f}"


def number(value: object, infinite: str = "∞") -> str:
    """A number of a table; empty if there is none."""
    if value is None or value == "":
        return ""
    if not isinstance(value, int | float):
        return str(value)
    if math.isinf(value):
        return infinite
    if math.isnan(value):
        return "neither"
    return str(value) if isinstance(value, int) else f"{value:.4g}" if abs(value) < 10_000 else f"{value:,.0f}"


def _short(value: float) -> float:
    return float(f"{value:.5g}")


def dumps(data: object) -> str:
    """JSON that a script element can hold."""
    return json.dumps(data, separators=(",", ":"), allow_nan=False).replace("<", "\\u003c")
