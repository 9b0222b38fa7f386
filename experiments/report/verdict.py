"""What a comparison of arms shows: transfer, harm, a core that was refused, or no evidence.

The question is experience: how good a run's policy was over the whole of its budget, which is the area under the curve of its
evaluations. The end alone is the condition that nothing was harmed.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from typing import TYPE_CHECKING, Literal

import numpy as np
from numpy.typing import NDArray

from transferkit import stats

if TYPE_CHECKING:
    from transferkit.stats import Difference

TRANSFER, SCRATCH = "transfer", "scratch"
CONTROLS = ("random", "random-matched", "shuffled")
"""What the core has to beat beside scratch: they share its architecture and its place, and lack what it learnt."""

POSITIVE, HARMFUL, REFUSED, NONE = "transfer", "harmful", "refused", "no evidence"

REFUSALS = 0.9
"""Share of the runs that refuse a core from which on it counts as refused."""

MARGIN = 0.05
"""How far the end may be below scratch, as a share of what lies between the references."""

FEW = 5
"""Seeds below which an interval says little beyond its assumption that differences are normal."""

Scores = NDArray[np.float64]
"""`(members, seeds)`, NaN if a run is missing; one row for an arm without a core."""


@dataclass(frozen=True)
class Verdict:
    """A verdict and what it rests on."""

    kind: str
    """`transfer`, `harmful`, `refused` or `no evidence`."""
    reason: str
    """In words, a sentence."""
    measure: Literal["area", "end"] = "end"
    """What it goes by: the area under the curve, or the end if runs were evaluated at their end only."""
    primary: Mapping[str, Difference] = field(default_factory=dict)
    """Transfer minus scratch and each control in that measure, with the intervals of Holm's test over all of them."""
    controls: Mapping[str, Difference] = field(default_factory=dict)
    """Transfer minus each control at the end, with the intervals of Holm's test over the controls."""
    scratch: Difference | None = None
    """Transfer minus scratch at the end."""
    gained: Difference | None = None
    """Transfer minus scratch in area."""


def judge(
    ends: Mapping[str, Scores], areas: Mapping[str, Scores] | None = None, *, span: float | None = None, refused: float = 0.0
) -> Verdict:
    """The verdict on a core, a target and a trainer.

    *Refused*: by at least nine of ten runs of the transfer. *Harmful*: end or area below scratch (interval below 0).
    *Transfer*: area above scratch and above every control (Holm-corrected intervals above 0), and the end not inferior to
    scratch (lower end of the interval of the difference above minus 5 % of the span). *No evidence*: anything else, a missing
    arm included. Without areas the end stands for them.

    Args:
        ends: final evaluations by arm.
        areas: areas under the curves of evaluations by arm.
        span: what lies between the two references of the target; without it the end has no margin.
        refused: share of the transfer's runs that refused the core.
    """
    if TRANSFER not in ends:
        return Verdict(NONE, "The core was not run.")
    found = _compared(ends, areas or {})
    kind, reason, decided = _decide(found, [name for name in (*CONTROLS, SCRATCH) if name not in ends], span, refused)
    fewest = min((difference.n for difference in decided if difference), default=FEW)
    if fewest < FEW:
        reason += f" From {fewest} seeds only: it holds if differences are normal; run at least {FEW}."
    return replace(found, kind=kind, reason=reason)


def paired(scores: Mapping[str, Scores], arms: tuple[str, ...]) -> dict[str, Scores]:
    """The arms' scores over the seeds that every one of them has completely."""
    complete = np.all([np.isfinite(scores[arm]).all(axis=0) for arm in arms], axis=0)
    return {arm: scores[arm][:, complete] for arm in arms}


def difference(scores: Mapping[str, Scores], arm: str) -> Difference | None:
    """Transfer minus an arm over the seeds that both have; None if there are fewer than two."""
    if not {TRANSFER, arm} <= scores.keys():
        return None
    usable = paired(scores, (TRANSFER, arm))
    return stats.paired_difference(usable[TRANSFER], usable[arm]) if usable[arm].shape[1] >= 2 else None


def _compared(ends: Mapping[str, Scores], areas: Mapping[str, Scores]) -> Verdict:
    """Every difference that a verdict rests on."""
    by_area = TRANSFER in areas and bool(np.isfinite(areas[TRANSFER]).any())
    return Verdict(
        NONE,
        "",
        "area" if by_area else "end",
        primary=_differences(areas if by_area else ends, (SCRATCH, *CONTROLS)),
        controls=_differences(ends, CONTROLS),
        scratch=difference(ends, SCRATCH),
        gained=difference(areas, SCRATCH) if by_area else None,
    )


def _differences(scores: Mapping[str, Scores], arms: Sequence[str]) -> dict[str, Difference]:
    present = [name for name in arms if name in scores]
    usable = paired(scores, (TRANSFER, *present))
    if not present or usable[TRANSFER].shape[1] < 2:
        return {}
    return stats.holm_differences(usable[TRANSFER], {name: usable[name] for name in present})


def _decide(
    found: Verdict, lacking: Sequence[str], span: float | None, refused: float
) -> tuple[str, str, Sequence[Difference | None]]:
    """The kind, the reason, and the differences that decided."""
    if refused >= REFUSALS:
        return REFUSED, f"Probation refused the core in {refused:.0%} of the runs, and they began from scratch.", ()
    for where, gain in (("ends", found.scratch), ("is on the whole", found.gained)):
        if gain is not None and gain.high < 0:
            return HARMFUL, f"The core {where} below training from scratch, by {-gain.mean:.4g} ({_interval(gain)}).", (gain,)
    on_the_whole = " on the whole" if found.measure == "area" else ""
    if missing := _missing(found, lacking, on_the_whole):
        return NONE, missing, ()
    assert found.scratch is not None
    against = f"the end against scratch {found.scratch.mean:+.4g}, {_interval(found.scratch)}"
    if not found.scratch.low > -MARGIN * (span or 0.0):  # nor if it is no number
        return NONE, f"The core beats scratch and every control{on_the_whole}, but may end below scratch ({against}).", ()
    reason = f"The core beats scratch and every control{on_the_whole} in paired differences ({against})."
    return POSITIVE, reason, (*found.primary.values(), found.scratch)


def _missing(found: Verdict, lacking: Sequence[str], on_the_whole: str) -> str:
    """What a claim lacks beside its end; nothing if it lacks nothing."""
    if not_beaten := [name for name, difference in found.primary.items() if not difference.low > 0]:
        worst = min(not_beaten, key=lambda name: found.primary[name].low)
        amount = f"{worst}: {found.primary[worst].mean:+.4g}, {_interval(found.primary[worst])}"
        return f"The core is not clearly better than {' and '.join(not_beaten)}{on_the_whole} ({amount})."
    if lacking:
        return f"A claim of transfer needs the arms {', '.join(lacking)}, which were not run."
    return "" if found.primary and found.scratch else "Fewer than two seeds have all arms."


def _interval(difference: Difference) -> str:
    return f"interval {difference.low:.4g} to {difference.high:.4g}, n {difference.n}"
