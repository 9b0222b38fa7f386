"""What a comparison of arms shows: transfer, no evidence of it, or negative transfer."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from transferkit import stats

if TYPE_CHECKING:
    from transferkit.stats import Difference

TRANSFER, SCRATCH = "transfer", "scratch"
CONTROLS = ("random", "random-matched", "shuffled")
"""What the core has to beat: they share its architecture and its place in the sandwich, and lack what it learnt."""

POSITIVE, NEGATIVE, NONE = "transfer", "negative transfer", "no evidence"

FEW = 5
"""Seeds below which an interval says little beyond its assumption that differences are normal."""

Scores = NDArray[np.float64]
"""`(members, seeds)`, NaN if a run is missing; one row for an arm without a core."""


@dataclass(frozen=True)
class Verdict:
    """A verdict and what it rests on."""

    kind: str
    """`transfer`, `no evidence` or `negative transfer`."""
    reason: str
    """In words, a sentence."""
    controls: Mapping[str, Difference] = field(default_factory=dict)
    """Transfer minus each control, with the intervals of Holm's test."""
    scratch: Difference | None = None
    """Transfer minus scratch."""


def judge(scores: Mapping[str, Scores]) -> Verdict:
    """The verdict on a core, a target and a trainer.

    *Transfer*: better than every control (Holm-corrected interval of the paired difference above 0) and in the mean not below
    scratch.
    *Negative transfer*: below scratch (interval below 0). *No evidence*: anything else, a missing arm included.
    """
    if TRANSFER not in scores:
        return Verdict(NONE, "The core was not run.")
    controls, scratch = _differences(scores), _difference(scores, SCRATCH)
    kind, reason = _decide(controls, scratch, [name for name in (*CONTROLS, SCRATCH) if name not in scores])
    decided = {POSITIVE: (*controls.values(), scratch), NEGATIVE: (scratch,), NONE: ()}[kind]
    fewest = min((difference.n for difference in decided if difference), default=FEW)
    if fewest < FEW:
        reason += f" From {fewest} seeds only: it holds if differences are normal; run at least {FEW}."
    return Verdict(kind, reason, controls, scratch)


def paired(scores: Mapping[str, Scores], arms: tuple[str, ...]) -> dict[str, Scores]:
    """The arms' scores over the seeds that every one of them has completely."""
    complete = np.all([np.isfinite(scores[arm]).all(axis=0) for arm in arms], axis=0)
    return {arm: scores[arm][:, complete] for arm in arms}


def _differences(scores: Mapping[str, Scores]) -> dict[str, Difference]:
    present = [name for name in CONTROLS if name in scores]
    usable = paired(scores, (TRANSFER, *present))
    if not present or usable[TRANSFER].shape[1] < 2:
        return {}
    return stats.holm_differences(usable[TRANSFER], {name: usable[name] for name in present})


def _difference(scores: Mapping[str, Scores], arm: str) -> Difference | None:
    if arm not in scores:
        return None
    usable = paired(scores, (TRANSFER, arm))
    return stats.paired_difference(usable[TRANSFER], usable[arm]) if usable[arm].shape[1] >= 2 else None


def _decide(controls: Mapping[str, Difference], scratch: Difference | None, lacking: Sequence[str]) -> tuple[str, str]:
    if scratch is not None and scratch.high < 0:
        return NEGATIVE, f"The core ends below training from scratch, by {-scratch.mean:.4g} ({_interval(scratch)})."
    not_beaten = [name for name, difference in controls.items() if difference.low <= 0]
    if not_beaten:
        worst = min(not_beaten, key=lambda name: controls[name].low)
        names = " and ".join(not_beaten)
        amount = f"{worst}: {controls[worst].mean:+.4g}, {_interval(controls[worst])}"
        return NONE, f"The core is not clearly better than {names} ({amount})."
    if lacking:
        return NONE, f"A claim of transfer needs the arms {', '.join(lacking)}, which were not run."
    if not controls or scratch is None:
        return NONE, "Fewer than two seeds have all arms."
    against = f"against scratch {scratch.mean:+.4g}, {_interval(scratch)}"
    if scratch.mean < 0:
        return NONE, f"The core beats every control, but is not above training from scratch ({against})."
    return POSITIVE, f"The core beats every control in paired differences ({against})."


def _interval(difference: Difference) -> str:
    return f"interval {difference.low:.4g} to {difference.high:.4g}, n {difference.n}"
