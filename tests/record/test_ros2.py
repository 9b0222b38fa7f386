import sys
import time
import tracemalloc

import numpy as np
import pytest
from mcap.writer import Writer as McapWriter
from mcap_ros2.writer import Writer

from transferkit.errors import RecordingError
from transferkit.record.mapping import load_mapping, read_mapped

JOINT_STATE = """# what a joint does, string[] is not a field
int8 NO_EFFORT=-1
std_msgs/Header header

string[] name
float64[] position   # rad
float64[] velocity
float64[] effort
================================================================================
MSG: std_msgs/Header
builtin_interfaces/Time stamp
string frame_id "world"
================================================================================
MSG: builtin_interfaces/Time
int32 sec
uint32 nanosec
"""
COMMAND = """float32[2] data
uint8[<=4] more
"""
OUTCOME = """Inner inner
bool done
===
MSG: lab_msgs/Inner
float64 value 0.5
"""
MAPPING = """[observation]
topic = "/joint_states"
fields = ["position.0", "position.1", "velocity.0", "header.stamp.nanosec"]
[action]
topic = "/command"
fields = ["data.1"]
[reward]
topic = "/outcome"
field = "inner.value"
[terminated]
topic = "/outcome"
field = "done"
"""


@pytest.fixture
def channels(tmp_path):
    (tmp_path / "mapping.toml").write_text(MAPPING)
    return load_mapping(tmp_path / "mapping.toml")


@pytest.fixture
def robot(tmp_path):
    """Four steps, written by the library."""
    path = tmp_path / "robot.mcap"
    with path.open("wb") as file, Writer(file) as writer:
        state, command, outcome = (
            writer.register_msgdef(name, text)
            for name, text in (
                ("sensor_msgs/msg/JointState", JOINT_STATE),
                ("lab_msgs/msg/Command", COMMAND),
                ("lab_msgs/msg/Outcome", OUTCOME),
            )
        )
        for k in range(4):
            joints = {"name": ["a", "bc"], "position": [k, 10.5 + k], "velocity": [-k, 0.0], "effort": []}
            joints["header"] = {"stamp": {"sec": 1, "nanosec": 7 * k}, "frame_id": "base"}
            writer.write_message("/joint_states", state, joints, log_time=100 * k)
            writer.write_message("/command", command, {"data": [0.0, k / 4], "more": [1]}, log_time=100 * k + 1)
            done = {"inner": {"value": 2.0 + k}, "done": k == 3}
            writer.write_message("/outcome", outcome, done, log_time=100 * k + 2)
    return path


def forged(path, definition, data, name="lab_msgs/msg/T"):
    """A file with one message on every topic."""
    with path.open("wb") as file:
        writer = McapWriter(file)
        writer.start()
        schema = writer.register_schema(name, "ros2msg", definition if isinstance(definition, bytes) else definition.encode())
        for topic in ("/joint_states", "/command", "/outcome"):
            writer.add_message(writer.register_channel(topic, "cdr", schema), 1, data, 1)
        writer.finish()
    return path


def test_arrays_nested_fields_and_stamps_are_read(robot, channels, pendulum_spec):
    found = read_mapped(robot, channels, pendulum_spec)
    np.testing.assert_array_equal(found.observation, [[k, 10.5 + k, -k, 7 * k] for k in range(4)])
    np.testing.assert_array_equal(found.action, [[k / 4] for k in range(4)])
    np.testing.assert_array_equal(found.reward, [2, 3, 4, 5])
    np.testing.assert_array_equal(found.terminated, [False, False, False, True])


DATA = b"\0\1\0\0"
CHAIN = "uint8 x\nlab_msgs/C0 c\n" + "".join(f"===\nMSG: lab_msgs/C{k}\nC{k + 1} c\n" for k in range(12))


@pytest.mark.parametrize(
    ("definition", "data", "message"),
    [
        pytest.param("float64 x", DATA, "does not decode as cdr", id="cut"),
        pytest.param("string x", DATA + b"\xff\0\0\0ab", "it is cut", id="cut in a string"),
        pytest.param("float64 x", b"", "encapsulation is none", id="empty"),
        pytest.param("float64 x", b"\0\7\0\0" + bytes(8), "encapsulation is 0007", id="another CDR"),
        pytest.param("float64 x", DATA + bytes(2**16), "at most 65536 are read", id="large message"),
        pytest.param("U[] x\n===\nMSG: lab_msgs/U\nuint8[1] u", DATA + b"\xff" * 4, "it is cut", id="4e9 empty elements"),
        pytest.param("float64[] x", DATA + b"\xff" * 4, "does not decode", id="4e9 numbers"),
        pytest.param("uint8[999999999] x", DATA, "it is cut", id="fixed size"),
        pytest.param("T x", DATA, "nest more than 10 deep", id="endless type"),
        pytest.param(CHAIN, DATA, "nest more than 10 deep", id="deep type"),
        pytest.param("int8 " + "A" * 60 + "a=1\nfloat64 x", DATA, "does not decode", id="constant that stops a regex"),
        pytest.param("".join(f"int8 x{k}\n" for k in range(5000)), DATA, "at most 4096 are read", id="many fields"),
        pytest.param("#" * 2**18 + "\nfloat64 x", DATA, "at most 262144 are read", id="large definition"),
        pytest.param("float64", DATA, "has the line 'float64'", id="half a line"),
        pytest.param("float64 X", DATA, "invalid field name", id="name"),
        pytest.param("Other x", DATA + bytes(9), "definition not found", id="no such type"),
        pytest.param("wstring x", DATA + bytes(9), "not implemented", id="wide string"),
        pytest.param(b"\xff\xfe", DATA, "does not decode", id="not text"),
    ],
)
def test_what_is_damaged_or_forged_is_one_line_at_once(tmp_path, channels, pendulum_spec, capfd, definition, data, message):
    path, started = forged(tmp_path / "x.mcap", definition, data), time.perf_counter()
    tracemalloc.start()
    try:
        with pytest.raises(RecordingError, match=message) as error:
            read_mapped(path, channels, pendulum_spec)
        assert tracemalloc.get_traced_memory()[1] < 2**25
    finally:
        tracemalloc.stop()
    assert time.perf_counter() - started < 2
    assert "\n" not in str(error.value)
    assert capfd.readouterr() == ("", "")


def test_a_type_and_a_schema_that_are_not_ros_2s_are_one_line(tmp_path, channels, pendulum_spec):
    with pytest.raises(RecordingError, match="does not decode"):
        read_mapped(forged(tmp_path / "x.mcap", "float64 x", DATA + bytes(8), "nonsense"), channels, pendulum_spec)
    with (tmp_path / "y.mcap").open("wb") as file:
        writer = McapWriter(file)
        writer.start()
        schema = writer.register_schema("lab_msgs/msg/T", "ros2idl", b"module lab_msgs {};")
        writer.add_message(writer.register_channel("/joint_states", "cdr", schema), 1, DATA, 1)
        writer.finish()
    with pytest.raises(RecordingError, match="encoding ros2idl, ros2msg is read"):
        read_mapped(tmp_path / "y.mcap", channels, pendulum_spec)


def test_without_the_package_it_is_said_what_to_install(robot, channels, pendulum_spec, monkeypatch):
    monkeypatch.setitem(sys.modules, "mcap_ros2.decoder", None)
    with pytest.raises(RecordingError, match=r"mcap_ros2.* is missing; pip install mcap-ros2-support"):
        read_mapped(robot, channels, pendulum_spec)
