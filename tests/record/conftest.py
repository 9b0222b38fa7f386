import json

import pytest
from mcap.reader import make_reader
from mcap.writer import Writer

from tests.record.foreign import MAPPING, write_foreign
from transferkit import load_subject, make_env, record_episodes
from transferkit.record.format import ABOUT, STEP, as_metadata, from_metadata
from transferkit.streams import Streams

ENV = "Hopper-v5"


@pytest.fixture(scope="session")
def subject():
    return load_subject("inverted-pendulum-v1", env=ENV)


@pytest.fixture(scope="session")
def recording(subject, tmp_path_factory):
    path = tmp_path_factory.mktemp("recording") / "hopper.mcap"
    record_episodes(subject, path, episodes=3, seed=4)
    return path


@pytest.fixture(scope="session")
def played(subject):
    """The episodes of the recording, stepped by hand: tuples of all that a step gives."""
    env, streams, steps = make_env(ENV), Streams(4), []
    for k in range(3):
        observation, done = env.reset(seed=streams.integer("evaluation", k))[0], False
        while not done:
            action = subject.policy.act(observation[None])[0]
            following, reward, terminated, truncated, info = env.step(action)
            steps.append((observation, action, reward, following, terminated, truncated, info))
            observation, done = following, terminated or truncated
    return steps


@pytest.fixture
def altered(recording, tmp_path):
    """Writes the recording again with other steps or another description of the file, each changed in place by a function."""

    def write(step=lambda _: None, about=lambda _: None):
        target = tmp_path / "altered.mcap"
        with recording.open("rb") as source, target.open("wb") as file:
            reader, writer = make_reader(source), Writer(file)
            writer.start()
            (found,) = [channel for channel in reader.get_summary().channels.values() if channel.topic == STEP]
            channel = writer.register_channel(STEP, found.message_encoding, writer.register_schema("step", "jsonschema", b"{}"))
            for record in reader.iter_metadata():
                data = from_metadata(record.metadata, dict)
                if record.name == ABOUT:
                    about(data)
                writer.add_metadata(record.name, as_metadata(data))
            for _, _, message in reader.iter_messages([STEP]):
                data = json.loads(message.data)
                step(data)
                writer.add_message(channel, message.log_time, json.dumps(data).encode(), message.log_time)
            writer.finish()
        return target

    return write


@pytest.fixture
def mapping(tmp_path):
    path = tmp_path / "mapping.toml"
    path.write_text(MAPPING)
    return path


@pytest.fixture
def foreign(tmp_path):
    return write_foreign(tmp_path / "robot.mcap")
