"""`transferkit play` without a display, run for real; tests/play has the viewer."""

import json

import imageio_ffmpeg
import pytest
from matplotlib.image import imread

from tests.cli.commands import refusal
from tests.test_physics import run_headless
from transferkit import TrainConfig, run_training
from transferkit.config import with_settings
from transferkit.play.camera import SIZE
from transferkit.play.curves import WIDTH

CORE, ENV = "inverted-pendulum-v1", "InvertedDoublePendulum-v5"
SMALL = {"ppo.num_envs": 1, "ppo.rollout_steps": 64, "ppo.epochs": 1, "network.hidden": [8]}


@pytest.fixture(scope="module")
def trained(tmp_path_factory):
    """A finished run, which is not much of a policy."""
    out = tmp_path_factory.mktemp("trained") / "run"
    run_training(with_settings(TrainConfig(ENV, algo="ppo", steps=200, eval_episodes=1), SMALL), out=out)
    return out


def played(folder, *arguments):
    """What it answers as JSON; None, and one line, on a machine without a GL driver."""
    done = run_headless(folder, "-m", "transferkit", "play", *map(str, arguments), "--json")
    if done.returncode == 0:
        assert done.stderr == ""
        return json.loads(done.stdout)
    assert (done.returncode, done.stderr.count("\n")) == (2, 1)
    assert "nothing can be rendered here" in done.stderr
    return None


def size_of(video):
    frames = imageio_ffmpeg.read_frames(str(video))
    return next(frames)["source_size"]


def test_a_core_is_filmed_with_its_inputs(tmp_path):
    shown = played(tmp_path, CORE, "--env", ENV, "--inputs")
    if shown is not None:
        name = f"{CORE}_{ENV}.mp4"
        assert (shown["file"], shown["whole"], shown["inputs"]) == (name, True, "core input")
        assert [path.name for path in tmp_path.iterdir()] == [name]
        assert size_of(tmp_path / name) == (SIZE + WIDTH, SIZE)
        frames = imageio_ffmpeg.count_frames_and_secs(str(tmp_path / name))[0]
        assert frames == -(-(shown["episodes"][0]["steps"] + 1) // round(1 / (30 * 0.05)))  # every moment that is due
        assert (
            f"{name} exists; choose another --out"
            in run_headless(tmp_path, "-m", "transferkit", "play", CORE, "--env", ENV).stderr
        )


@pytest.mark.parametrize("env", [None, "dm_control/cartpole-balance-v0"])
def test_a_run_becomes_a_strip_of_pictures_with_bars_below(trained, tmp_path, env):
    elsewhere = [] if env is None else ["--env", env, "--seconds", 1]
    plain = played(tmp_path, trained, *elsewhere, "--out", "x.png")
    if plain is not None:
        shown = played(tmp_path, trained, *elsewhere, "--inputs", "--out", "y.png")
        assert shown == {**plain, "file": "y.png", "inputs": "observation" if env is None else "core input"}
        assert plain["whole"] == (env is None)
        (height, width, _), (higher, wider, _) = imread(tmp_path / "x.png").shape, imread(tmp_path / "y.png").shape
        assert width > 4 * height
        assert (higher > 1.5 * height, wider > width) == (True, True)


def test_it_says_why_there_is_a_file(tmp_path):
    done = run_headless(tmp_path, "-m", "transferkit", "play", CORE, "--seconds", "1")
    if done.returncode == 0:
        name = f"{CORE}_InvertedPendulum-v5.mp4"
        said = [
            f"no display: wrote {name}; 1 episode, 25 steps, return 25.0",
            "it ends before the episodes do, after 1 s of simulated time; --seconds sets another length",
        ]
        assert done.stdout.splitlines() == said


def test_mistakes_are_one_line(capsys, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    (tmp_path / "old.mp4").touch()
    monkeypatch.setattr("transferkit.cli.play.choose_renderer", lambda: None)
    for arguments, message in {
        "nothing-v1 --out x.mp4": "unknown run or core 'nothing-v1'",
        f"{CORE} --out old.mp4": "old.mp4 exists; choose another --out",
        f"{CORE} --out x.png --episodes 2": "x.png shows one episode; leave out --episodes, or make a video: --out FILE.mp4",
        f"{CORE} --env nothing-v5 --out x.mp4": "unknown environment 'nothing-v5'",
    }.items():
        assert message in refusal(capsys, "play", *arguments.split())
    assert [path.name for path in tmp_path.iterdir()] == ["old.mp4"]
