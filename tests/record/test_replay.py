import pytest

from transferkit import (
    load_subject,
    record_episodes,
    replay_recording,
)
from transferkit.errors import RecordingError
from transferkit.record.reader import read
from transferkit.versions import versions

ENV = "Hopper-v5"


def test_replay_is_the_same_to_the_bit(recording, altered):
    found = replay_recording(recording)
    assert (found.episodes, found.difference, found.versions, found.flaw) == (3, "", {}, "")
    assert replay_recording(altered()) == found


def test_replay_says_which_versions_differ(altered):
    def older(about):
        about["versions"]["mujoco"] = "1.2.3"

    assert replay_recording(altered(about=older)).versions == {"mujoco": ("1.2.3", versions()["mujoco"])}


def test_replay_says_where_it_first_differs(altered):
    def nudge(step):
        """Another action than was played."""
        if step["episode"] > 0 or step["step"] >= 7:
            step["action"] = {name: value + 1e-3 for name, value in step["action"].items()}

    assert replay_recording(altered(nudge)).difference.startswith("episode 0, step 7: the control")


@pytest.mark.parametrize("name", ["observation", "control", "reward", "next_observation"])
def test_replay_compares_every_number(altered, name):
    def change(step):
        if name in step:
            step[name] = step[name] + 5 if name == "reward" else dict.fromkeys(step[name], 5.0)

    assert name.replace("next", "final").replace("_", " ") in replay_recording(altered(change)).difference


def test_a_recording_of_a_newer_format_asks_for_an_upgrade(altered):
    with pytest.raises(RecordingError, match="has recording format 9, this transferkit reads up to 1; upgrade"):
        replay_recording(altered(about=lambda about: about.update(format="9")))


def test_dm_control_is_recorded_under_its_id(tmp_path):
    subject = load_subject("inverted-pendulum-v1", env="dm_control/cartpole-balance-v0")
    record_episodes(subject, tmp_path / "twin.mcap")
    assert read(tmp_path / "twin.mcap").about.spec.env_id == "dm_control/cartpole-balance-v0"
    found = replay_recording(str(tmp_path / "twin.mcap"))
    assert (found.steps, found.difference) == (1000, "")
