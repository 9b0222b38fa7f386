import json
from itertools import pairwise

import mujoco
import numpy as np
import pytest
from foxglove_schemas_protobuf.FrameTransforms_pb2 import FrameTransforms
from foxglove_schemas_protobuf.SceneUpdate_pb2 import SceneUpdate
from mcap.reader import make_reader
from mcap_protobuf.decoder import DecoderFactory

from transferkit import (
    load_subject,
    make_env,
    record_episodes,
)
from transferkit.record.format import SCENE, STEP, TRANSFORMS

ENV = "Hopper-v5"


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
    record_episodes(load_subject("inverted-pendulum-v1", env="HalfCheetah-v5"), tmp_path / "cheetah.mcap")
    with (tmp_path / "cheetah.mcap").open("rb") as file:
        reader = make_reader(file, decoder_factories=[DecoderFactory()])
        steps = [json.loads(message.data) for _, _, message in reader.iter_messages([STEP])]
        poses = {message.log_time: decoded for _, _, message, decoded in reader.iter_decoded_messages([TRANSFORMS])}
    model = make_env("HalfCheetah-v5").unwrapped.model
    data = mujoco.MjData(model)
    for k in (0, 400, 998):  # across the batches that are encoded together
        data.qpos[:] = list(steps[k]["qpos"].values())
        mujoco.mj_kinematics(model, data)
        found = [[t.translation.x, t.translation.y, t.translation.z] for t in poses[k * 50_000_000].transforms]
        np.testing.assert_allclose(found, data.xpos[1:], atol=1e-12)
