"""Recordings, read with the public packages and with our own reader."""

import json
import resource
from itertools import pairwise

import mujoco
import numpy as np
import pytest
import torch
from foxglove_schemas_protobuf.FrameTransforms_pb2 import FrameTransforms
from foxglove_schemas_protobuf.SceneUpdate_pb2 import SceneUpdate
from mcap.reader import make_reader
from mcap.records import Footer
from mcap.stream_reader import StreamReader
from mcap_protobuf.decoder import DecoderFactory

from transferkit.deploy import load_subject
from transferkit.envs import derive_spec, make_env
from transferkit.errors import NotFiniteError, RecordingError
from transferkit.evaluation import evaluate
from transferkit.record.format import ABOUT, EPISODE, SCENE, STEP, TRANSFORMS, Names
from transferkit.record.play import Subject, record
from transferkit.record.reader import read, read_transitions
from transferkit.record.recover import recover
from transferkit.record.replay import replay
from transferkit.run.streams import Streams

ENV = "Hopper-v5"


def played(subject, seed, episodes):
    """The same episodes, stepped by hand."""
    env, streams, steps = make_env(ENV), Streams(seed), []
    for k in range(episodes):
        observation, done = env.reset(seed=streams.integer("evaluation", k))[0], False
        while not done:
            action = subject.policy.act(observation[None])[0]
            following, reward, terminated, truncated, info = env.step(action)
            steps.append((observation, action, reward, following, terminated, truncated, info))
            observation, done = following, terminated or truncated
    return steps


def test_the_reference_reader_finds_every_number_by_its_name(recording, subject):
    steps = played(subject, 4, 3)
    with recording.open("rb") as file:
        assert isinstance([*StreamReader(file, validate_crcs=True).records][-1], Footer)  # every checksum is right
        file.seek(0)
        reader = make_reader(file, decoder_factories=[DecoderFactory()])
        summary = reader.get_summary()
        assert {channel.topic for channel in summary.channels.values()} == {STEP, SCENE, TRANSFORMS}
        assert summary.statistics.chunk_count >= 1
        messages = [(message.log_time, json.loads(message.data)) for _, _, message in reader.iter_messages([STEP])]
        about = {record.name: record.metadata for record in reader.iter_metadata() if record.name == ABOUT}[ABOUT]
        episodes = [record.metadata for record in reader.iter_metadata() if record.name == EPISODE]
    assert len(messages) == len(steps)
    names = Names.of(derive_spec(ENV), **subject.policy.trace_names())
    trace = subject.policy.trace(torch.from_numpy(np.stack([step[0] for step in steps])))
    for k in (0, 1, len(steps) - 1):
        (time, message), (observation, action, reward, following, *_, info) = messages[k], steps[k]
        assert time == round(k * 0.008 * 1e9)
        np.testing.assert_array_equal([np.float32(message["observation"][n]) for n in names.observation], observation)
        np.testing.assert_array_equal([np.float32(message["action"][n]) for n in names.action], action)
        core_input = [message["core_input"][n] for n in names.core_input]
        np.testing.assert_allclose(core_input, trace["core_input"][k].detach(), rtol=1e-4, atol=1e-5)
        assert len(message["core_output"]) == 64
        assert message["reward"] == reward
        assert message["reward_terms"] == {n: v for n, v in info.items() if n.startswith("reward_")}
        np.testing.assert_allclose(list(message["control"].values()), action, rtol=1e-6)  # Hopper's actuators take [-1, 1]
    assert messages[-1][1]["terminated"]
    np.testing.assert_array_equal([np.float32(messages[-1][1]["next_observation"][n]) for n in names.observation], following)
    assert json.loads(about["core"]) == "inverted-pendulum-v1"
    assert json.loads(about["spec"])["env_id"] == ENV
    assert [json.loads(episode["steps"]) for episode in episodes] == [
        sum(message["episode"] == k for _, message in messages) for k in range(3)
    ]


def test_returns_are_those_of_an_evaluation(recording, subject):
    totals = [episode["total"] for episode in read(recording).episodes]
    assert totals == pytest.approx(evaluate(subject.policy, ENV, episodes=3, seed=4).returns)


def test_the_scene_decodes_with_the_published_schemas(recording):
    with recording.open("rb") as file:
        reader = make_reader(file, decoder_factories=[DecoderFactory()])
        decoded = list(reader.iter_decoded_messages([SCENE, TRANSFORMS]))
    published = {SCENE: SceneUpdate, TRANSFORMS: FrameTransforms}
    for schema, channel, raw, message in decoded:
        assert schema.name == published[channel.topic].DESCRIPTOR.full_name
        assert published[channel.topic].FromString(raw.data).SerializeToString() == message.SerializeToString()
    scenes = [message for _, channel, _, message in decoded if channel.topic == SCENE]
    poses = [(record.log_time, message) for _, channel, record, message in decoded if channel.topic == TRANSFORMS]
    assert len(scenes) == 3
    entities = {entity.id: entity for entity in scenes[0].entities}
    assert set(entities) == {"world", "torso", "thigh", "leg", "foot"}
    assert len(entities["torso"].cylinders) == 1  # a capsule: a cylinder and two caps
    assert len(entities["torso"].spheres) == 2
    assert entities["world"].cubes[0].size.z < 0.1  # the floor
    assert {frame.child_frame_id for frame in poses[0][1].transforms} == {"torso", "thigh", "leg", "foot"}
    heights = [frame.translation.z for _, m in poses for frame in m.transforms if frame.child_frame_id == "torso"]
    assert heights[0] == pytest.approx(1.25, abs=0.01)
    assert min(heights) < 1.1  # it falls
    assert {b - a for (a, _), (b, _) in pairwise(poses[:5])} == {32_000_000}  # every fourth step: at most 30 a second


def test_poses_are_those_of_the_recorded_state(tmp_path):
    """The simulator's own lag a step of the physics behind where it integrates by Euler's method."""
    record(load_subject("inverted-pendulum-v1", env="HalfCheetah-v5"), tmp_path / "cheetah.mcap")
    steps = read(tmp_path / "cheetah.mcap").steps
    with (tmp_path / "cheetah.mcap").open("rb") as file:
        reader = make_reader(file, decoder_factories=[DecoderFactory()])
        poses = {message.log_time: decoded for _, _, message, decoded in reader.iter_decoded_messages([TRANSFORMS])}
    model = make_env("HalfCheetah-v5").unwrapped.model
    data = mujoco.MjData(model)
    for k in (0, 400, 998):  # across the batches that are encoded together
        data.qpos[:] = list(steps[k]["qpos"].values())
        mujoco.mj_kinematics(model, data)
        found = [[t.translation.x, t.translation.y, t.translation.z] for t in poses[k * 50_000_000].transforms]
        np.testing.assert_allclose(found, data.xpos[1:], atol=1e-12)


def test_transitions_are_what_was_played(recording, subject):
    found = read_transitions(recording, derive_spec(ENV))
    columns = [np.array(column) for column in list(zip(*played(subject, 4, 3), strict=True))[:6]]
    columns[1] = columns[1].clip(-1, 1)
    names = ("observation", "action", "reward", "next_observation", "terminated", "truncated")
    for name, column in zip(names, columns, strict=True):
        np.testing.assert_array_equal(getattr(found, name), column.astype(getattr(found, name).dtype))
    assert found.notes == ()


def test_a_file_cut_anywhere_gives_its_whole_chunks(recording, tmp_path):
    data, whole = recording.read_bytes(), len(read(recording).steps)
    cut, counts = tmp_path / "cut.mcap", []
    for size in np.linspace(0, len(data) - 1, 50).astype(int):
        cut.write_bytes(data[:size])
        if size < 8:
            with pytest.raises(RecordingError, match="is no MCAP file"):
                read(cut)
            continue
        contents = read(cut)
        assert not contents.complete
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
        assert read(out).complete == (len(read(out).episodes) == 3)
    assert counts == sorted(counts)
    assert counts[-1] == whole
    assert 0 < counts[len(counts) * 3 // 4] < whole
    cut.write_bytes(data[: len(data) * 3 // 4])
    found = read_transitions(cut, derive_spec(ENV))
    assert "is cut" in found.notes[0]
    assert str(len(found)) in found.notes[0]


def test_replay_is_the_same_to_the_bit_and_says_what_differs(recording, monkeypatch, tmp_path):
    found = replay(recording)
    assert (found.episodes, found.difference, found.versions) == (3, "", {})
    here = importlib_versions()
    monkeypatch.setattr("transferkit.record.replay.versions", lambda: here | {"mujoco": "9.9.9"})
    assert replay(recording).versions == {"mujoco": (here["mujoco"], "9.9.9")}
    monkeypatch.setattr("transferkit.record.reader.orjson.loads", nudged)
    assert replay(recording).difference.startswith("episode 0, step 7: the control")


def importlib_versions():
    from transferkit.versions import versions

    return versions()


def nudged(data):
    """A step whose action is another one than was played."""
    step = json.loads(data)
    if step["step"] == 7:
        step["action"] = {name: value + 1e-3 for name, value in step["action"].items()}
    return step


@pytest.mark.parametrize("name", ["observation", "control", "reward", "next_observation"])
def test_replay_compares_every_number(recording, monkeypatch, name):
    def changed(data):
        step = json.loads(data)
        if name in step:
            step[name] = step[name] + 5 if name == "reward" else dict.fromkeys(step[name], 5.0)
        return step

    monkeypatch.setattr("transferkit.record.reader.orjson.loads", changed)
    assert name.replace("next", "final").replace("_", " ") in replay(recording).difference


def test_dm_control_is_recorded_under_its_id(tmp_path):
    subject = load_subject("inverted-pendulum-v1", env="dm_control/cartpole-balance-v0")
    record(subject, tmp_path / "twin.mcap")
    assert read(tmp_path / "twin.mcap").about["env"] == "dm_control/cartpole-balance-v0"
    found = replay(tmp_path / "twin.mcap")
    assert (found.steps, found.difference) == (1000, "")


def test_a_cores_critic_gives_values(core_with_parts, tmp_path, monkeypatch):
    monkeypatch.setattr("transferkit.deploy.load_core", lambda _: core_with_parts)
    record(load_subject("test-v1"), tmp_path / "values.mcap")
    step = read(tmp_path / "values.mcap").steps[0]
    observation = torch.tensor([list(step["observation"].values())])
    value = core_with_parts.critic()(observation, torch.tensor([list(step["action"].values())]).clamp(-1, 1)).mean()
    assert step["value"] == pytest.approx(value.item(), rel=1e-4)


def test_a_full_disk_is_one_error(subject, tmp_path):
    soft, hard = resource.getrlimit(resource.RLIMIT_FSIZE)
    resource.setrlimit(resource.RLIMIT_FSIZE, (100_000, hard))
    try:
        with pytest.raises(RecordingError, match=r"cannot write on .*full\.mcap.*make room"):
            record(subject, tmp_path / "full.mcap", episodes=5)
    finally:
        resource.setrlimit(resource.RLIMIT_FSIZE, (soft, hard))


def test_nothing_is_overwritten_and_nan_is_refused(recording, subject, tmp_path):
    with pytest.raises(RecordingError, match="exists; pass another --out"):
        record(subject, recording)
    with pytest.raises(RecordingError, match="folder that exists"):
        record(subject, tmp_path / "nowhere" / "x.mcap")

    class Broken:
        def act(self, observation):
            return np.full((1, 3), np.nan, np.float32)

        def trace_names(self):
            return {}

        def trace(self, observation):
            return {}

    with pytest.raises(NotFiniteError, match="step 0 of episode 0"):
        record(Subject(Broken(), ENV, about={}), tmp_path / "nan.mcap")
    assert read(tmp_path / "nan.mcap").steps == []
