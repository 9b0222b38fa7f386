from experiments import peer_runs
from experiments.matrix.results import read_results


def test_runs_of_a_peer_enter_a_matrix_and_are_not_run_again(tmp_path, capsys):
    arguments = ["--env", "InvertedPendulum-v5", "--steps", "2048", "--seeds", "100", "100"]
    peer_runs.main([*arguments, "--out", str(tmp_path / "known/peer.csv")])
    assert "InvertedPendulum-v5, seed 100: " in capsys.readouterr().out
    (row,) = read_results(tmp_path).finished
    assert (row.trainer, row.seed, row.steps, row.eval_episodes) == ("stable-baselines3", 100, 2048, 20)
    assert 3 <= row.eval_return_mean < 1000  # alive for some steps, not solved in so few
    peer_runs.main([*arguments, "--out", str(tmp_path / "known/peer.csv")])
    assert not capsys.readouterr().out
