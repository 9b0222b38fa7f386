import itertools
from dataclasses import replace
from types import SimpleNamespace

import pytest

from experiments.matrix.table import Row
from experiments.report.comparisons import compare
from experiments.study.rooms import StudyError
from experiments.study.rungs import rungs


def run(arm, core, member, seed, points):
    identity = (f"{arm}{member}{seed}", core, member, "Walker2d-v5", arm, "ppo", "ppo", "default-v5", "{}", seed)
    area = sum((a + b) / 2 for a, b in itertools.pairwise(points)) / (len(points) - 1)
    row = Row(*identity, 200, 20_000, None, 1000, 5, 1, 2, 1.0, eval_return_mean=points[-1], eval_return_std=0.0)
    return replace(row, area=area, first_return_mean=points[0]), points


def test_a_rung_by_hand(tmp_path):
    """Six seeds alike: the core has 100 from its second evaluation on, scratch 50 at its end."""
    seeds = range(6)
    made = [run("transfer", "hopper-v1", 0, seed, [0.0, 100.0, 100.0 + seed]) for seed in seeds]
    made += [run("scratch", "", 0, seed, [0.0, 25.0, 50.0 - seed]) for seed in seeds]
    arms = ("random", "random-matched", "shuffled")
    made += [run(arm, "hopper-v1", 0, seed, [0.0, 0.0, float(seed)]) for arm in arms for seed in seeds]
    rows = [row for row, _ in made]
    curves = {
        row.id: [{"steps": 1000.0 * k, "return_mean": one, "core": row.arm == "transfer"} for k, one in enumerate(points)]
        for row, points in made
    }
    header, line = rungs(SimpleNamespace(rows=rows, groups=compare(rows), curves=curves))
    told = dict(zip(header, line, strict=True))
    assert (told["rung"], told["core on target"]) == ("7", "`hopper-v1` on Walker2d-v5")
    assert told["area: core, scratch"] == "76, 24"  # (50 + 101.25) / 2, (12.5 + 36.25) / 2
    assert told["end: core, scratch"] == "102, 48"
    assert told["below scratch's lower quartile"] == "0%"
    assert told["steps saved"] == "> 2 (2 to 2) to 75"  # 1000 against more than 2000
    assert told["verdict"] == "transfer, of one member"
    (tmp_path / "grid.toml").write_text('targets = ["Walker2d-v5"]')
    stated = SimpleNamespace(rows=rows, groups=compare(rows), curves=curves, folder=tmp_path)
    _, line = rungs(stated, thresholds={"Walker2d-v5": 25.0})
    assert dict(zip(header, line, strict=True))["steps saved"] == "1 (1 to 1) to 25"  # stated before: both after 1000
    assert told["below the untrained core"] == "0%"
    starts = {0: 200.0, 1: 105.0}  # seed 0 ends at 100, and seed 1 at 101 with a noise of 2 sqrt(2 / 5) 10 = 12.6
    begun = [
        replace(row, first_return_mean=starts.get(row.seed, 0.0), eval_return_std=10.0) if row.arm == "transfer" else row
        for row in rows
    ]
    _, line = rungs(SimpleNamespace(rows=begun, groups=compare(begun), curves=curves))
    assert dict(zip(header, line, strict=True))["below the untrained core"] == "17%"
    with pytest.raises(StudyError, match="thresholds: Walker2d is no target of the grid"):
        rungs(stated, thresholds={"Walker2d": 25.0})
    some = [row for row in rows if (row.arm, row.seed) not in (("transfer", 0), ("scratch", 5))]
    _, line = rungs(SimpleNamespace(rows=some, groups=compare(some), curves=curves))
    told = dict(zip(header, line, strict=True))
    assert (told["steps saved"], told["below scratch's lower quartile"]) == ("> 2 (2 to 2) to 76", "0%")  # of seeds 1 to 4
