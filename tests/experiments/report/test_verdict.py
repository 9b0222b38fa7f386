import numpy as np
import pytest

from experiments.report.verdict import NEGATIVE, NONE, POSITIVE, judge

SEEDS = np.arange(10.0)
"""What the seeds share; paired differences are free of it."""

NOISE = np.array([0.3, -0.2, 0.1, 0.0, -0.1, 0.2, -0.3, 0.1, 0.0, -0.1])


def arm(level, rows=1):
    return np.array([level + SEEDS + NOISE * (k + 1) for k in range(rows)])


ARMS = {
    "transfer": arm(5.0, 2),
    "scratch": arm(4.0),
    "random": arm(2.0, 2),
    "random-matched": arm(2.5, 2),
    "shuffled": arm(1.0, 2),
}


@pytest.mark.parametrize(
    ("changed", "kind", "word"),
    [
        ({}, POSITIVE, "beats every control"),
        ({"shuffled": arm(5.0, 2)}, NONE, "not clearly better than shuffled"),
        ({"scratch": arm(8.0)}, NEGATIVE, "below training from scratch, by 3"),
        ({"scratch": arm(5.01) + 3 * NOISE}, NONE, "not above training from scratch"),
        ({"random-matched": None}, NONE, "needs the arms random-matched"),
        ({"scratch": None}, NONE, "needs the arms scratch"),
        ({"transfer": None}, NONE, "was not run"),
        ({"scratch": arm(8.0), "random": np.where(SEEDS < 1, arm(2.0, 2), np.nan)}, NEGATIVE, "below training from scratch"),
        ({"random": np.where(SEEDS < 1, arm(2.0, 2), np.nan)}, NONE, "Fewer than two seeds"),
    ],
)
def test_a_claim_of_transfer_needs_every_control(changed, kind, word):
    arms = {name: scores for name, scores in (ARMS | changed).items() if scores is not None}
    verdict = judge(arms)
    assert verdict.kind == kind
    assert word in verdict.reason


def test_pairs_that_lack_a_run_are_left_out_of_both_arms():
    broken = arm(4.0)
    broken[0, :2] = np.nan
    verdict = judge(ARMS | {"scratch": broken})
    assert verdict.scratch.n == 8
    assert verdict.scratch.mean == pytest.approx(1.0 + NOISE[2:].mean() / 2)
    assert verdict.controls["random"].n == 10


def test_too_few_pairs_say_nothing():
    assert judge({name: scores[:, :1] for name, scores in ARMS.items()}).kind == NONE


def test_a_claim_from_few_seeds_says_so():
    few = judge({name: scores[:, :3] for name, scores in ARMS.items()})
    assert few.kind == POSITIVE
    assert few.reason.endswith("From 3 seeds only: it holds if differences are normal; run at least 5.")
    assert "only" not in judge(ARMS).reason
    late = ARMS | {"scratch": arm(8.0), "random": ARMS["random"][:, :3]}
    late["random"] = np.pad(late["random"], ((0, 0), (0, 7)), constant_values=np.nan)
    assert "only" not in judge(late).reason  # negative, by ten seeds of scratch
