"""Recordings in: our own, other tools' by a mapping, Minari's."""

import json
import signal
from dataclasses import replace

import numpy as np
import pytest
import torch
from foxglove_schemas_protobuf.Vector3_pb2 import Vector3
from mcap.writer import Writer
from mcap_protobuf.schema import register_schema

from transferkit.config import DynaConfig, TrainConfig
from transferkit.dyna.replay import Batch, ReplayBuffer
from transferkit.envs import derive_spec
from transferkit.errors import ConfigError, Interrupted, RecordingError
from transferkit.record.datasets import export_minari, read_minari
from transferkit.record.experience import load_experience
from transferkit.record.mapping import load_mapping, read_mapped
from transferkit.record.reader import read_transitions
from transferkit.run.session import Session
from transferkit.trained import load_policy
from transferkit.transfer import run_training

ENV = "Hopper-v5"
TINY = DynaConfig(hidden=(16, 16), model_hidden=(16,), updates_per_step=1, batch_size=32, model_share=0.5, model_updates=20)
MAPPING = """
[observation]
topic = "/state"
fields = ["position.0", "position.1", "velocity.0", "velocity.1"]
[action]
topic = "/command"
fields = ["x"]
[reward]
topic = "/reward"
field = "value"
[terminated]
topic = "/reward"
field = "done"
"""


@pytest.fixture
def mapping(tmp_path):
    path = tmp_path / "mapping.toml"
    path.write_text(MAPPING)
    return path


@pytest.fixture
def foreign(tmp_path):
    return write_foreign(tmp_path / "robot.mcap")


def write_foreign(path, steps=5):
    """States, commands a little later, a reward for all steps but the third; JSON and protobuf."""
    with path.open("wb") as file:
        writer = Writer(file)
        writer.start()
        plain = writer.register_schema("any", "jsonschema", b"{}")
        state, reward = (writer.register_channel(topic, "json", plain) for topic in ("/state", "/reward"))
        command = writer.register_channel("/command", "protobuf", register_schema(writer, Vector3))
        for k in range(steps):
            at = 100 * k
            message = {"position": [k, 10 + k], "velocity": [20 + k, 30 + k]}
            writer.add_message(state, at, json.dumps(message).encode(), at)
            writer.add_message(command, at + 10, Vector3(x=k / 10).SerializeToString(), at + 10)
            if k != 2:
                writer.add_message(reward, at + 20, json.dumps({"value": 7.0 + k, "done": k == 3}).encode(), at + 20)
        writer.finish()
    return path


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
        ("[reward]", "[rewards]", r"unknown table \[rewards\]"),
        ("[action]", "[action", "cannot read the mapping"),
        ('topic = "/command"', "", "without 'topic'"),
    ],
)
def test_a_wrong_mapping_is_one_line(foreign, mapping, pendulum_spec, old, new, message):
    mapping.write_text(MAPPING.replace(old, new, 1))
    with pytest.raises(RecordingError, match=message) as error:
        read_mapped(foreign, load_mapping(mapping), pendulum_spec)
    assert "\n" not in str(error.value)


def test_files_that_do_not_fit_are_refused(foreign, recording, tmp_path, pendulum_spec):
    text = tmp_path / "text.mcap"
    text.write_text("not a recording at all")
    hopper = derive_spec(ENV)
    other_version = replace(hopper, observation=hopper.observation[1:])
    for path, spec, message in (
        (text, pendulum_spec, "is no MCAP file"),
        (tmp_path / "nothing.mcap", pendulum_spec, "cannot read"),
        (foreign, pendulum_spec, "--mapping"),
        (recording, pendulum_spec, "was recorded in Hopper-v5, not in InvertedPendulum-v5"),
        (recording, other_version, "has 11 observation elements"),
    ):
        with pytest.raises(RecordingError, match=message) as error:
            read_transitions(path, spec)
        assert "\n" not in str(error.value)


def test_nan_is_refused(foreign, mapping, pendulum_spec, monkeypatch):
    monkeypatch.setattr("transferkit.record.mapping._value", lambda *_: float("nan"))
    with pytest.raises(RecordingError, match="NaN or infinity in observation, first in step 0"):
        read_mapped(foreign, load_mapping(mapping), pendulum_spec)


def test_minari_there_and_back(recording, tmp_path, monkeypatch):
    monkeypatch.setenv("MINARI_DATASETS_PATH", str(tmp_path))
    spec = derive_spec(ENV)
    assert export_minari([recording], "hopper/test-v0") == len(read_transitions(recording, spec))
    there, back = read_transitions(recording, spec), read_minari("hopper/test-v0", spec)
    for name in ("observation", "action", "reward", "next_observation", "terminated", "truncated"):
        np.testing.assert_array_equal(getattr(there, name), getattr(back, name))
    with pytest.raises(RecordingError, match="pass another --minari"):
        export_minari([recording], "hopper/test-v0")
    with pytest.raises(RecordingError, match="no Minari dataset none/such-v0"):
        read_minari("none/such-v0", spec)
    with pytest.raises(RecordingError, match=r"InvertedPendulum-v5 has \(4,\)"):
        read_minari("hopper/test-v0", derive_spec("InvertedPendulum-v5"))
    both, ledger = load_experience([str(recording), "minari:hopper/test-v0"], None, spec)
    assert len(both) == 2 * len(there) == sum(entry["steps"] for entry in ledger)


def test_a_buffer_takes_many_rows_and_keeps_the_newest():
    rows = lambda n, first=0: Batch(  # noqa: E731
        torch.arange(first, first + n).float()[:, None], torch.zeros(n, 1), torch.zeros(n), torch.zeros(n, 1), torch.zeros(n)
    )
    many, one = ReplayBuffer(1, 1, 3000), ReplayBuffer(1, 1, 3000)
    many.extend(rows(2500))
    many.extend(rows(1000, 2500))
    for row in range(3500):
        one.add(Batch(*(column[row] for column in rows(3500))))
    assert torch.equal(many.all().observation, one.all().observation)
    assert many.added == one.added == 3500
    few = ReplayBuffer(1, 1, 10)
    few.extend(rows(25))
    assert few.recent(10).observation.flatten().tolist() == list(range(15, 25))


def test_training_starts_from_recordings_and_resumes_to_the_bit(recording, tmp_path, monkeypatch):
    config = TrainConfig(ENV, algo="dyna-ddpg", steps=300, eval_episodes=1, checkpoint_seconds=0.0, dyna=TINY)
    config = replace(config, experience=(str(recording),))
    whole = run_training(config, out=tmp_path / "whole")
    assert whole.prior_steps == len(read_transitions(recording, derive_spec(ENV)))
    assert whole.steps == 300
    checkpoint = Session.checkpoint

    def interrupt(self, state):
        checkpoint(self, state)
        if self.spent.steps == 200 and not monkeypatch.undo():
            signal.raise_signal(signal.SIGINT)

    monkeypatch.setattr(Session, "checkpoint", interrupt)
    with pytest.raises(Interrupted):
        run_training(config, out=tmp_path / "cut")
    resumed = run_training(config, out=tmp_path / "cut", resume=True)
    assert resumed.prior_steps == whole.prior_steps
    weights = [load_policy(tmp_path / run).state_dict() for run in ("whole", "cut")]
    assert all(torch.equal(weights[0][name], weights[1][name]) for name in weights[0])


def test_only_dyna_ddpg_learns_from_recordings():
    with pytest.raises(ConfigError, match="ppo does not learn from recordings"):
        TrainConfig(ENV, experience=("x.mcap",))
