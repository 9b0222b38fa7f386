import numpy as np
import pytest

from experiments.report.verdict import HARMFUL, NONE, POSITIVE, REFUSED, difference, judge

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
        ({}, POSITIVE, "beats scratch and every control"),
        ({"shuffled": arm(5.0, 2)}, NONE, "not clearly better than shuffled"),
        ({"scratch": arm(8.0)}, HARMFUL, "below training from scratch, by 3"),
        ({"scratch": arm(5.01) + 3 * NOISE}, NONE, "not clearly better than scratch"),
        ({"random-matched": None}, NONE, "needs the arms random-matched"),
        ({"scratch": None}, NONE, "needs the arms scratch"),
        ({"transfer": None}, NONE, "was not run"),
        ({"scratch": arm(8.0), "random": np.where(SEEDS < 1, arm(2.0, 2), np.nan)}, HARMFUL, "below training from scratch"),
        ({"random": np.where(SEEDS < 1, arm(2.0, 2), np.nan)}, NONE, "Fewer than two seeds"),
    ],
)
def test_a_claim_of_transfer_needs_every_control(changed, kind, word):
    arms = {name: scores for name, scores in (ARMS | changed).items() if scores is not None}
    verdict = judge(arms)
    assert verdict.kind == kind
    assert word in verdict.reason


EVEN = {name: arm(5.0, len(scores)) for name, scores in ARMS.items()}
"""All arms end alike."""


@pytest.mark.parametrize(
    ("ends", "areas", "span", "kind", "word"),
    [
        (EVEN, ARMS, 10.0, POSITIVE, "on the whole"),
        (EVEN, ARMS, None, NONE, "may end below scratch"),  # without references there is no margin
        (EVEN | {"scratch": arm(5.1) + 5 * NOISE}, ARMS, 10.0, NONE, "may end below scratch"),
        (EVEN | {"scratch": arm(5.1) + 5 * NOISE}, ARMS, 100.0, POSITIVE, "on the whole"),
        (EVEN | {"scratch": arm(5.4) + 2 * NOISE}, ARMS, 100.0, HARMFUL, "ends below"),
        (ARMS, EVEN | {"scratch": arm(6.0)}, 10.0, HARMFUL, "is on the whole below training from scratch, by 1"),
        (ARMS, EVEN, 10.0, NONE, "not clearly better than scratch and random and random-matched and shuffled on the whole"),
        (ARMS, {name: np.full_like(scores, np.nan) for name, scores in ARMS.items()}, 10.0, POSITIVE, "paired differences"),
    ],
    ids=[
        "area",
        "no span",
        "an end that may be worse",
        "an end within the margin",
        "a worse end",
        "a worse area",
        "equal areas",
        "ends alone",
    ],
)
def test_the_area_decides_and_the_end_may_not_be_worse(ends, areas, span, kind, word):
    verdict = judge(ends, areas, span=span)
    assert (verdict.kind, verdict.measure) == (kind, "end" if np.isnan(areas["transfer"]).all() else "area")
    assert word in verdict.reason


def test_holm_is_over_scratch_and_the_three_controls():
    verdict = judge(EVEN, ARMS, span=10.0)
    assert set(verdict.primary) == {"scratch", "random", "random-matched", "shuffled"}
    assert verdict.primary["shuffled"].mean == pytest.approx(4.0)
    assert verdict.gained.mean == pytest.approx(1.0 + NOISE.mean() / 2)


def test_a_core_that_nine_of_ten_runs_refuse_is_refused():
    below = ARMS | {"scratch": arm(8.0)}
    assert [judge(below, refused=share).kind for share in (1.0, 0.9, 0.89)] == [REFUSED, REFUSED, HARMFUL]
    assert "90%" in judge(below, refused=0.9).reason


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


def test_without_the_core_there_is_no_difference_to_it():
    assert difference({"scratch": ARMS["scratch"]}, "scratch") is None


@pytest.mark.filterwarnings("ignore:overflow", "ignore:invalid value")
def test_an_interval_that_is_no_number_is_not_above_anything():
    huge = np.array([[1e200, 1.1e200, 1.2e200, *[1.3e200] * 7]])
    found = judge(ARMS | {"scratch": huge}, ARMS, span=100.0)
    assert found.kind != POSITIVE
