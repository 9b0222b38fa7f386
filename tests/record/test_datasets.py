import errno

import numpy as np
import pytest

from transferkit import derive_spec, read_transitions
from transferkit.errors import RecordingError
from transferkit.record.datasets import export_minari, read_minari
from transferkit.record.experience import load_experience

ENV = "Hopper-v5"


def test_minari_there_and_back(recording, tmp_path, monkeypatch):
    monkeypatch.setenv("MINARI_DATASETS_PATH", str(tmp_path))
    spec = derive_spec(ENV)
    assert export_minari([recording], "hopper/test-v0") == len(read_transitions(recording, spec))
    there, back = read_transitions(recording, spec), read_minari("hopper/test-v0", spec)
    for name in ("observation", "action", "reward", "next_observation", "terminated", "truncated"):
        np.testing.assert_array_equal(getattr(there, name), getattr(back, name))
    with pytest.raises(RecordingError, match="choose another minari"):
        export_minari([recording], "hopper/test-v0")
    with pytest.raises(RecordingError, match="no Minari dataset none/such-v0"):
        read_minari("none/such-v0", spec)
    with pytest.raises(RecordingError, match=r"InvertedPendulum-v5 has \(4,\)"):
        read_minari("hopper/test-v0", derive_spec("InvertedPendulum-v5"))
    both, ledger = load_experience([str(recording), "minari:hopper/test-v0"], None, spec)
    assert len(both) == 2 * len(there) == sum(entry["steps"] for entry in ledger)


def test_an_export_that_fails_leaves_no_dataset_that_takes_the_name(recording, tmp_path, monkeypatch):
    monkeypatch.setenv("MINARI_DATASETS_PATH", str(tmp_path))

    def fail(*_):
        raise OSError(errno.ENOSPC, "no space")

    with monkeypatch.context() as broken:
        broken.setattr("minari.dataset.minari_storage.MinariStorage.update_metadata", fail)
        with pytest.raises(RecordingError, match=r"cannot write .* no space; choose another"):
            export_minari([recording], "hopper/test-v0")
    assert export_minari([recording], "hopper/test-v0") > 0
