import pytest
import torch

from transferkit.errors import RunDirectoryError
from transferkit.run import load_state, save_state


def test_states_make_the_round_trip(tmp_path):
    state = {"a": torch.arange(3), "n": [1, 2.5, None, "x"], "nested": {0: {"t": torch.ones(2, 2)}, "k": []}}
    save_state(tmp_path / "s", state)
    loaded = load_state(tmp_path / "s")
    assert torch.equal(loaded["a"], state["a"])
    assert torch.equal(loaded["nested"][0]["t"], state["nested"][0]["t"])
    assert loaded["n"] == state["n"]
    assert loaded["nested"]["k"] == []


@pytest.mark.parametrize("keep", [0, 5, 40, -1])
def test_a_cut_state_file_is_refused(tmp_path, keep):
    save_state(tmp_path / "s", {"a": torch.arange(100)})
    data = (tmp_path / "s").read_bytes()
    (tmp_path / "s").write_bytes(data[:keep])
    with pytest.raises(RunDirectoryError, match="is damaged"):
        load_state(tmp_path / "s")
