import numpy as np
import pytest
from mcap.reader import make_reader

from transferkit import (
    derive_spec,
    read_transitions,
)
from transferkit.errors import RecordingError
from transferkit.record.reader import read
from transferkit.record.recover import recover

ENV = "Hopper-v5"


def test_a_file_cut_anywhere_gives_its_whole_chunks(recording, tmp_path):
    data, whole = recording.read_bytes(), len(read(recording).steps)
    with recording.open("rb") as file:
        whole_messages = len(list(make_reader(file).iter_messages()))
    cut, counts = tmp_path / "cut.mcap", []
    for size in np.linspace(0, len(data) - 1, 50).astype(int):
        cut.write_bytes(data[:size])
        if size < 8:
            with pytest.raises(RecordingError, match="is not an MCAP file"):
                read(cut)
            continue
        contents = read(cut)
        assert contents.flaw
        counts.append(len(contents.steps))
        out = tmp_path / f"{size}.mcap"
        if not contents.steps:
            with pytest.raises(RecordingError, match="nothing can be recovered"):
                recover(cut, out)
            continue
        messages, was_cut = recover(cut, out)
        assert was_cut
        with out.open("rb") as file:
            recovered = list(make_reader(file).iter_messages())
        assert len(recovered) == messages
        assert len(read(out).steps) == counts[-1]
        assert messages == whole_messages or read(out).flaw
    assert counts == sorted(counts)
    assert counts[-1] == whole
    assert 0 < counts[len(counts) * 3 // 4] < whole
    cut.write_bytes(data[: len(data) * 3 // 4])
    found = read_transitions(cut, derive_spec(ENV))
    assert "is cut" in found.notes[0]
    assert str(len(found)) in found.notes[0]
