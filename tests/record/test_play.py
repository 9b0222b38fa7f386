"""Recordings, read with the public packages."""

import json
import resource

import numpy as np
import pytest
import torch
from mcap.reader import make_reader
from mcap.records import Footer
from mcap.stream_reader import StreamReader
from mcap_protobuf.decoder import DecoderFactory

from transferkit import (
    Subject,
    derive_spec,
    evaluate,
    load_subject,
    record_episodes,
)
from transferkit.errors import NotFiniteError, RecordingError
from transferkit.record.format import ABOUT, EPISODE, SCENE, STEP, TRANSFORMS, Names
from transferkit.record.reader import read

ENV = "Hopper-v5"


def test_the_reference_reader_finds_every_number_by_its_name(recording, subject, played):
    steps = played
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
    totals = [step.return_ for step in read(recording).steps if step.ended]
    assert totals == pytest.approx(evaluate(subject.policy, ENV, episodes=3, seed=4).returns)


def test_a_cores_critic_gives_values(full_core, full_core_folder, tmp_path):
    record_episodes(load_subject(str(full_core_folder)), tmp_path / "values.mcap")
    step = read(tmp_path / "values.mcap").steps[0]
    observation = torch.tensor([list(step.observation.values())])
    value = full_core.critic()(observation, torch.tensor([list(step.action.values())]).clamp(-1, 1)).mean()
    assert step.value == pytest.approx(value.item(), rel=1e-4)


@pytest.mark.parametrize(("size", "again", "left"), [(100_000, "record again", False), (400_000, "another out", True)])
def test_a_full_disk_is_one_error_and_leaves_a_file_only_if_there_are_steps_in_it(subject, tmp_path, size, again, left):
    soft, hard = resource.getrlimit(resource.RLIMIT_FSIZE)
    resource.setrlimit(resource.RLIMIT_FSIZE, (size, hard))
    try:
        with pytest.raises(RecordingError, match=rf"cannot go on writing .*full\.mcap.*make room.*{again}$"):
            record_episodes(subject, tmp_path / "full.mcap", episodes=5)
    finally:
        resource.setrlimit(resource.RLIMIT_FSIZE, (soft, hard))
    assert (tmp_path / "full.mcap").exists() == left
    assert not left or read(tmp_path / "full.mcap").steps


def test_nothing_is_overwritten_and_nan_is_refused(recording, subject, tmp_path):
    with pytest.raises(RecordingError, match="exists; choose another out"):
        record_episodes(subject, recording)
    with pytest.raises(RecordingError, match="folder that exists"):
        record_episodes(subject, tmp_path / "nowhere" / "x.mcap")

    class Broken:
        def act(self, observation):
            return np.full((1, 3), np.nan, np.float32)

        def trace_names(self):
            return {}

        def trace(self, observation):
            return {}

    with pytest.raises(NotFiniteError, match="the policy chose an action with NaN or infinity in step 0"):
        record_episodes(Subject(Broken(), ENV, about={}), tmp_path / "nan.mcap")
    assert read(tmp_path / "nan.mcap").steps == []
