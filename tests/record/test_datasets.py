import minari
import numpy as np
import pytest
from gymnasium.spaces import Box
from minari.data_collector import EpisodeBuffer

from transferkit import derive_spec, read_transitions
from transferkit.errors import RecordingError
from transferkit.record.datasets import read_minari
from transferkit.record.experience import load_experience
from transferkit.record.minari_export import export_minari

ENV = "Hopper-v5"


@pytest.fixture(autouse=True)
def datasets(tmp_path, monkeypatch):
    monkeypatch.setenv("MINARI_DATASETS_PATH", str(tmp_path))


def test_files_and_datasets_are_learnt_from_together(recording):
    spec = derive_spec(ENV)
    assert export_minari([recording], "hopper/test-v0") == len(there := read_transitions(recording, spec))
    both, ledger = load_experience([str(recording), "minari:hopper/test-v0"], None, spec)
    assert len(both) == 2 * len(there) == sum(entry["steps"] for entry in ledger)
    with pytest.raises(RecordingError, match="no Minari dataset none/such-v0"):
        read_minari("none/such-v0", spec)
    with pytest.raises(RecordingError, match=r"InvertedPendulum-v5 has \(4,\)"):
        read_minari("hopper/test-v0", derive_spec("InvertedPendulum-v5"))


@pytest.mark.parametrize(
    ("low", "high", "actions", "shares"),
    [
        pytest.param(-1.0, 1.0, [0.3, -1.0], [0.3, -1.0], id="shares, as transferkit wrote until 0.1"),
        pytest.param(-0.4, 0.4, [0.3, -0.4], [0.75, -1.0], id="own units, float32 bounds"),
        pytest.param(1.0, 5.0, [2.0, 5.0], [-0.5, 1.0], id="not symmetric"),
        pytest.param(-np.inf, np.inf, [0.3, -0.4], [0.3, -0.4], id="no bounds"),
    ],
)
def test_actions_become_shares_of_their_spaces_range(pendulum_spec, low, high, actions, shares):
    buffer = EpisodeBuffer(
        id=0,
        observations=list(np.zeros((3, 4), np.float32)),
        actions=[np.array([value], np.float32) for value in actions],
        rewards=[0.0, 0.0],
        terminations=[False, True],
        truncations=[False, False],
    )
    spaces = {"observation_space": Box(-1, 1, (4,)), "action_space": Box(low, high, (1,))}
    minari.create_dataset_from_buffers("other-v0", [buffer], **spaces)
    found = read_minari("other-v0", pendulum_spec)
    np.testing.assert_allclose(found.action[:, 0], np.float32(shares), rtol=1e-6)
    assert found.notes == ()
