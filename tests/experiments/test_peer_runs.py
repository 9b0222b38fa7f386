import pytest

from experiments import peer_runs
from experiments.matrix.results import read_results


def test_runs_of_a_peer_enter_a_matrix_and_are_not_run_again(tmp_path, capsys):
    arguments = ["--env", "InvertedPendulum-v5", "--steps", "2048", "--seeds", "100", "100"]
    peer_runs.main([*arguments, "--out", str(tmp_path / "known/peer.csv")])
    assert "InvertedPendulum-v5, seed 100: " in capsys.readouterr().out
    (row,) = read_results(tmp_path).finished
    assert (row.trainer, row.seed, row.steps, row.eval_episodes) == ("stable-baselines3", 100, 2048, 20)
    assert 3 <= row.eval_return_mean < 1000  # alive for some steps, not solved in so few
    assert peer_runs.main([*arguments, "--out", str(tmp_path / "known/peer.csv")]) == 0
    assert not capsys.readouterr().out


@pytest.mark.parametrize(
    ("flag", "value", "said"),
    [
        ("--env", ["Nope-v9"], "unknown environment 'Nope-v9'"),
        ("--steps", ["-5"], "--steps=-5 must be at least 1"),
        ("--workers", ["0"], "--workers=0 must be at least 1"),
        ("--seeds", ["3", "1"], "the last of --seeds 3 1 is below the first"),
    ],
)
def test_a_mistake_is_one_line(flag, value, said, tmp_path, capsys):
    options = {"--env": ["Hopper-v5"], "--steps": ["10"], "--seeds": ["0", "0"], "--out": [str(tmp_path / "x.csv")]}
    assert peer_runs.main([part for name, values in (options | {flag: value}).items() for part in (name, *values)]) == 2
    assert said in capsys.readouterr().err
