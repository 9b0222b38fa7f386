import numpy as np
import pytest

from tests.record.foreign import MAPPING, write_foreign
from transferkit.errors import RecordingError
from transferkit.record.mapping import load_mapping, read_mapped

ENV = "Hopper-v5"


def test_a_mapping_makes_steps_of_another_tools_topics(foreign, mapping, pendulum_spec):
    found = read_mapped(foreign, load_mapping(mapping), pendulum_spec)
    np.testing.assert_array_equal(found.observation, [[0, 10, 20, 30], [1, 11, 21, 31], [3, 13, 23, 33]])
    np.testing.assert_array_equal(found.next_observation, [[1, 11, 21, 31], [2, 12, 22, 32], [3, 13, 23, 33]])
    np.testing.assert_allclose(found.action, [[0.0], [0.1], [0.3]])
    np.testing.assert_array_equal(found.reward, [7, 8, 10])
    np.testing.assert_array_equal(found.terminated, [False, False, True])
    assert "1 steps lack an action or a reward" in found.notes[0]


def test_a_termination_at_the_end_of_a_file_is_taken(tmp_path, mapping, pendulum_spec):
    found = read_mapped(write_foreign(tmp_path / "robot.mcap", 4), load_mapping(mapping), pendulum_spec)
    np.testing.assert_array_equal(found.reward, [7, 8, 10])
    np.testing.assert_array_equal(found.terminated, [False, False, True])


def test_steps_that_ended_by_time_are_left_out_because_the_next_message_is_another_episodes(foreign, mapping, pendulum_spec):
    mapping.write_text(MAPPING.replace("[terminated]", "[truncated]"))
    found = read_mapped(foreign, load_mapping(mapping), pendulum_spec)
    assert found.observation[:, 0].tolist() == [0, 1]
    assert not found.truncated.any()
    assert "2 steps that ended by time or with the file are left out" in found.notes[1]


@pytest.mark.parametrize(
    ("old", "new", "message"),
    [
        ('topic = "/command"\nfields = ["x"]', 'topic = "/reward"\nfields = ["value"]', "actions beyond -1 to 1"),
        ('topic = "/command"', 'topic = "/cmd"', "has no topic /cmd"),
        ('"position.1"', '"position.7"', "topic /state has no field position.7"),
        ('fields = ["x"]', 'fields = ["x", "y"]', "names 2 action fields, InvertedPendulum-v5 has 1"),
        ("[reward]", "[rewards]", "unknown rewards; known are observation, action, reward"),
        ("[action]", "[action", "not TOML"),
        ('topic = "/command"', "", "missing required field `topic`"),
    ],
    ids=["actions too large", "topic", "field", "number of fields", "table", "not TOML", "no topic"],
)
def test_a_wrong_mapping_is_one_line(foreign, mapping, pendulum_spec, old, new, message):
    mapping.write_text(MAPPING.replace(old, new, 1))
    with pytest.raises(RecordingError, match=message) as error:
        read_mapped(foreign, load_mapping(mapping), pendulum_spec)
    assert "\n" not in str(error.value)


def test_nan_is_refused(mapping, tmp_path, pendulum_spec):
    foreign = write_foreign(tmp_path / "robot.mcap", command=lambda k: float("nan") if k == 1 else 0.0)
    with pytest.raises(RecordingError, match="NaN or infinity in action, first in step 1"):
        read_mapped(foreign, load_mapping(mapping), pendulum_spec)
