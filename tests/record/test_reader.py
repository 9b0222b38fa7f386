from dataclasses import replace

import numpy as np
import pytest

from transferkit import derive_spec, read_transitions
from transferkit.errors import RecordingError

ENV = "Hopper-v5"


def test_transitions_are_what_was_played(recording, played):
    found = read_transitions(recording, derive_spec(ENV))
    columns = [np.array(column) for column in list(zip(*played, strict=True))[:6]]
    columns[1] = columns[1].clip(-1, 1)
    names = ("observation", "action", "reward", "next_observation", "terminated", "truncated")
    for name, column in zip(names, columns, strict=True):
        np.testing.assert_array_equal(getattr(found, name), column.astype(getattr(found, name).dtype))
    assert found.notes == ()


def test_files_that_do_not_fit_are_refused(foreign, recording, tmp_path, pendulum_spec):
    text = tmp_path / "text.mcap"
    text.write_text("not a recording at all")
    hopper = derive_spec(ENV)
    other_version = replace(hopper, observation=hopper.observation[1:])
    for path, spec, message in (
        (text, pendulum_spec, "is not an MCAP file"),
        (tmp_path / "nothing.mcap", pendulum_spec, "cannot read"),
        (foreign, pendulum_spec, "is not a recording of transferkit; name its channels with mapping"),
        (recording, pendulum_spec, "was recorded in Hopper-v5, not in InvertedPendulum-v5"),
        (recording, other_version, "has 11 observation elements"),
    ):
        with pytest.raises(RecordingError, match=message) as error:
            read_transitions(path, spec)
        assert "\n" not in str(error.value)
