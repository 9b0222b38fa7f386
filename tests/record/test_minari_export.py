import errno
import json
import os
import subprocess
import sys

import gymnasium
import minari
import numpy as np
import pytest
from gymnasium.envs.mujoco.hopper_v5 import HopperEnv

from transferkit import derive_spec, load_subject, make_env, read_transitions, record_episodes
from transferkit.errors import EnvironmentContractError, RecordingError
from transferkit.record.datasets import read_minari
from transferkit.record.minari_export import export_minari
from transferkit.record.play import Subject

ENV = "Hopper-v5"
COLUMNS = ("observation", "action", "reward", "next_observation", "terminated", "truncated")


@pytest.fixture(autouse=True)
def datasets(tmp_path, monkeypatch):
    monkeypatch.setenv("MINARI_DATASETS_PATH", str(tmp_path / "minari"))


@pytest.fixture
def record(tmp_path):
    """Records a core in an environment."""

    def made(env, *, name="x.mcap", episodes=2, most=None, clip=True):
        policy = load_subject("inverted-pendulum-v1", env=env).policy
        record_episodes(Subject(policy, env, clip_actions=clip, max_episode_steps=most), tmp_path / name, episodes=episodes)
        return tmp_path / name

    return made


def check_recovers(dataset):
    """Every episode of a dataset is the same to the bit in the environment that it recovers; returns that environment."""
    loaded = minari.load_dataset(dataset)
    env = loaded.recover_environment()
    assert (env.observation_space, env.action_space) == (loaded.observation_space, loaded.action_space)
    for episode, metadata in zip(loaded, loaded.storage.get_episode_metadata(loaded.episode_indices), strict=True):
        observation, _ = env.reset(seed=metadata["seed"], options=metadata.get("options"))
        assert episode.observations.dtype == observation.dtype
        np.testing.assert_array_equal(episode.observations[0], observation)
        for k, action in enumerate(episode.actions):
            observation, reward, terminated, truncated, _ = env.step(action)
            np.testing.assert_array_equal(episode.observations[k + 1], observation)
            assert (episode.rewards[k], episode.terminations[k], episode.truncations[k]) == (reward, terminated, truncated)
        assert terminated or truncated
    return env


@pytest.mark.parametrize(
    ("env", "most"),
    [
        ("InvertedPendulum-v5", 30),
        ("Humanoid-v5", 30),
        ("Pusher-v5", None),
        ("dm_control/cheetah-run-v0", 20),
        ("dm_control/cartpole-balance-v0", None),
    ],
)
def test_the_environment_comes_back_and_gives_the_same_numbers(record, env, most):
    file, spec = record(env, most=most), derive_spec(env)
    export_minari([file], "my/there-v0")
    recovered = check_recovers("my/there-v0")
    assert recovered.spec.id == env
    there, back = read_transitions(file, spec), read_minari("my/there-v0", spec)
    for name in COLUMNS:
        np.testing.assert_array_equal(getattr(there, name), getattr(back, name))
    space = minari.load_dataset("my/there-v0").action_space
    actions = np.concatenate([episode.actions for episode in minari.load_dataset("my/there-v0")])
    assert actions.dtype == np.float64
    np.testing.assert_allclose(actions, there.action * space.high, rtol=1e-6)


def test_several_recordings_become_one_dataset_and_limits_must_be_the_same(record):
    files = [record(ENV, name=f"{k}.mcap", episodes=1 + k, most=7) for k in range(2)]
    assert export_minari(files, "both-v0") == 3 * 7
    check_recovers("both-v0")
    with pytest.raises(RecordingError, match=r"max_episode_steps 7, .* with None; export them apart"):
        export_minari([files[0], record(ENV, most=None)], "other-v0")


@pytest.fixture
def registered():
    """Registers an environment for a test."""
    names = []

    def register(name, entry_point, **kwargs):
        names.append(name)
        gymnasium.register(name, entry_point, max_episode_steps=6, kwargs=kwargs)
        return name

    yield register
    for name in names:
        gymnasium.registry.pop(name, None)


def test_keyword_arguments_come_back(record, registered):
    name = registered("Slow-v0", "gymnasium.envs.mujoco.hopper_v5:HopperEnv", frame_skip=10, healthy_z_range=(0.5, 9.0))
    export_minari([record(name)], "slow-v0")
    gymnasium.registry.pop(name)
    assert check_recovers("slow-v0").unwrapped.frame_skip == 10


def test_an_environment_that_json_cannot_name_is_not_recovered_and_that_is_said(record, registered, caplog):
    name = registered("Local-v0", lambda **_: HopperEnv())
    assert export_minari([record(name)], "local-v0") == 12
    assert "the dataset cannot recover its environment Local-v0: Callable found in Local-v0" in caplog.text
    assert minari.load_dataset("local-v0").env_spec is None


def test_actions_beyond_the_bounds_are_as_they_were_applied(record, caplog):
    class Loud:
        def act(self, observation):
            return np.full((len(observation), 3), 1.5, np.float32)

        def trace_names(self):
            return {}

        def trace(self, observation):
            return {}

    file = record(ENV, most=5)
    record_episodes(Subject(Loud(), ENV, clip_actions=False, max_episode_steps=5), file.with_name("loud.mcap"))
    steps = export_minari([file.with_name("loud.mcap")], "loud-v0")
    check_recovers("loud-v0")
    assert minari.load_dataset("loud-v0")[0].actions.max() == 1.5
    assert f"{steps} actions were applied beyond the environment's bounds" in caplog.text
    found = read_minari("loud-v0", derive_spec(ENV))
    assert found.action.max() == 1.0
    assert "5 actions beyond the bounds of their space are clipped" in found.notes[0]


def test_what_is_not_reproduced_is_written_as_recorded_and_said(altered, caplog):
    def other(step):
        if step["episode"] == 1:
            step["reward"] += 1.0

    file = altered(other, lambda about: about["versions"].update(mujoco="1.2.3"))
    export_minari([file], "other-v0")
    assert "1 of 3 episodes are not reproduced here, first in step 0 of episode 1" in caplog.text
    assert "mujoco 1.2.3 recorded" in caplog.text
    there, back = read_transitions(file, derive_spec(ENV)), read_minari("other-v0", derive_spec(ENV))
    for name in COLUMNS:
        np.testing.assert_array_equal(getattr(there, name), getattr(back, name))
    with pytest.warns(UserWarning, match="does not meet the requirement ==1.2.3"):
        minari.load_dataset("other-v0").recover_environment()


def test_an_episode_with_a_gap_is_left_out(altered, caplog):
    def renumber(step):
        if step["episode"] == 1 and step["step"] >= 3:
            step["step"] += 1

    steps = export_minari([altered(renumber)], "gap-v0")
    assert minari.load_dataset("gap-v0").total_episodes == 2
    assert minari.load_dataset("gap-v0").total_steps == steps
    assert "steps of episodes without a beginning or an end are left out" in caplog.text


def test_a_suite_task_is_recovered_where_transferkit_was_not_imported(record, tmp_path):
    export_minari([record("dm_control/cartpole-balance-v0", episodes=1, most=3)], "twin-v0")
    code = "import minari; print(minari.load_dataset('twin-v0').recover_environment().reset(seed=1)[0].tolist())"
    environment = os.environ | {"PYTHONPATH": os.pathsep.join(sys.path)}
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True, env=environment)
    env = make_env("dm_control/cartpole-balance-v0")
    assert json.loads(done.stdout) == env.reset(seed=1)[0].tolist()


def test_a_module_in_a_recordings_id_must_be_named(altered):
    file = altered(about=lambda about: about["spec"].update(env_id=f"gymnasium:{ENV}"))
    with pytest.raises(EnvironmentContractError, match=f"name it yourself: env=gymnasium:{ENV}"):
        export_minari([file], "x-v0")
    with pytest.raises(RecordingError, match=f"recorded in gymnasium:{ENV}, not in {ENV}"):
        export_minari([file], "x-v0", env=ENV)
    export_minari([file], "x-v0", env=f"gymnasium:{ENV}")
    check_recovers("x-v0")


def test_another_tools_recording_is_refused_without_a_flag_that_is_not_there(foreign):
    with pytest.raises(RecordingError, match="a dataset needs its seeds; record episodes with transferkit") as error:
        export_minari([foreign], "x-v0")
    assert "mapping" not in str(error.value)


def test_an_export_that_fails_leaves_no_dataset_that_takes_the_name(recording, monkeypatch):
    def fail(*_):
        raise OSError(errno.ENOSPC, "no space")

    with monkeypatch.context() as broken:
        broken.setattr("minari.dataset.minari_storage.MinariStorage.update_metadata", fail)
        with pytest.raises(RecordingError, match=r"cannot write .* no space; choose another"):
            export_minari([recording], "hopper/test-v0")
    assert export_minari([recording], "hopper/test-v0") > 0
    with pytest.raises(RecordingError, match="choose another minari"):
        export_minari([recording], "hopper/test-v0")
