"""Runs that are interrupted and compared."""

import json
import signal

import numpy as np
import torch

from transferkit.run import TABLES, load_state, read_table

TIMES = {"seconds", "run_dir", "files", "digest"}


def interrupt_at(steps):
    """A `report=` that presses Ctrl-C, once, after the first update from this step on."""
    pressed = []

    def report(spent, _):
        if spent.steps >= steps and not pressed:
            pressed.append(spent.steps)
            signal.raise_signal(signal.SIGINT)

    return report


def assert_same_run(one, other):
    """Compare everything that two finished runs wrote, to the bit, but their times and places."""
    results = [
        {name: value for name, value in json.loads((run / "result.json").read_text()).items() if name not in TIMES}
        for run in (one, other)
    ]
    assert results[0] == results[1]
    for kind in TABLES:
        assert (one / f"{kind.table}.csv").exists() == (other / f"{kind.table}.csv").exists()
        if (one / f"{kind.table}.csv").exists():
            np.testing.assert_array_equal(*(rows_without_times(run, kind) for run in (one, other)))
    assert_same_tensors(*(load_state(run / "policy.safetensors") for run in (one, other)))


def rows_without_times(run, kind):
    return [values for name, values in read_table(run, kind).items() if name not in TIMES]


def assert_same_tensors(one, other, path="policy"):
    if isinstance(one, torch.Tensor):
        assert torch.equal(one, other), path
    elif isinstance(one, dict):
        assert one.keys() == other.keys(), path
        for name in one:
            assert_same_tensors(one[name], other[name], f"{path}.{name}")
    else:
        assert one == other, path
