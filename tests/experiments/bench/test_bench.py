import logging

import pytest

from experiments.bench.__main__ import BENCHES, main


@pytest.mark.parametrize(
    ("name", "words"),
    [
        ("ppo", ("env steps per second", "rsl_rl's own (must be 1.3)", "transferkit zoo list")),
        ("dyna", ("stable-baselines3 TD3", "environment steps with the same updates", "matrix products alone")),
        ("model", ("an update of an ensemble", "matrix products alone")),
        ("record", ("Hopper-v5: recording takes", "KB per 1,000 steps")),
        ("probe", ("deriving the spec of 2 environments", "median")),
        ("report", ("report of 20 runs",)),
        ("matrix", ("2 cells: 2 workers are", "a cell costs")),
        ("paper", ("PPOPT, paper preset", "dyna-ddpg, Hopper-v5: after")),
    ],
)
def test_a_bench_runs_and_prints(name, words, capfd, monkeypatch):
    monkeypatch.setenv("OMP_NUM_THREADS", "1")
    assert main([name, "--tiny"]) == 0
    printed = capfd.readouterr().out
    for word in words:
        assert word in printed
    assert logging.getLogger().isEnabledFor(logging.WARNING)  # also for what is measured after it


def test_the_help_lists_every_bench(capsys):
    with pytest.raises(SystemExit):
        main(["--help"])
    printed = capsys.readouterr().out
    assert all(f"  {name}" in printed for name in BENCHES)
