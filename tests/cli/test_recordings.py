"""Each command of recordings, run for real."""

import pytest

from tests.cli.commands import refusal, run, run_json
from tests.record.foreign import MAPPING, write_foreign
from tests.test_physics import CARTPOLE, run_headless
from transferkit import load_subject, record_episodes
from transferkit.renderer import _renders

CORE = "inverted-pendulum-v1"


@pytest.fixture
def short_recording(monkeypatch, tmp_path):
    """A recording of nine steps."""
    monkeypatch.setattr("envs_dmc.suite.EPISODE_LIMIT", 9)
    monkeypatch.setattr("transferkit.envs.probe._DERIVED", {})
    record_episodes(load_subject(CORE, env=CARTPOLE), tmp_path / "x.mcap")
    return tmp_path / "x.mcap"


def test_a_recording_is_made_checked_drawn_mended_and_learnt_from(capsys, tmp_path):
    file, out = tmp_path / "run.mcap", tmp_path / "run"
    train = ["train", "--env", "InvertedDoublePendulum-v5", "--core", CORE, "--algo", "dyna-ddpg"]
    small = ["--steps", 200, "--eval-episodes", 1, "--dyna.updates-per-step", 1]
    assert run(capsys, *train, *small, "--eval-every", 100, "--record", "every=2", "--out", out)[0] == 0
    assert {path.name for path in (out / "recordings").iterdir()} == {"step_0.mcap", "step_200.mcap"}
    assert len(run_json(capsys, "record", out, "--episodes", 2, "--out", file)["episodes"]) == 2
    assert run(capsys, "replay", file, "--check")[1].endswith("reproduced to the bit\n")
    assert run(capsys, "plot", file)[0] == 0
    assert run(capsys, "plot", file, "--episode", 1)[1] == f"{tmp_path / 'run_1.png'}\n"
    assert all((tmp_path / name).stat().st_size > 10_000 for name in ("run.png", "run_1.png"))
    assert "run.png exists; choose another --out" in refusal(capsys, "plot", file)
    assert "has no step of episode 9; use --episode 0 to 1" in refusal(capsys, "plot", file, "--episode", 9)
    assert "is a recording and not a policy" in refusal(capsys, "play", file, "--out", tmp_path / "x.png")
    file.write_bytes(file.read_bytes()[:-20])
    assert "was cut" in run(capsys, "recover", file)[1]
    assert run(capsys, "replay", tmp_path / "run.recovered.mcap", "--check")[0] == 0
    assert run(capsys, *train, *small, "--experience", file, "--out", tmp_path / "again")[0] == 0


def test_a_core_becomes_a_file_and_a_dataset(capsys, tmp_path, monkeypatch):
    monkeypatch.setenv("MINARI_DATASETS_PATH", str(tmp_path / "minari"))
    assert run_json(capsys, "export", CORE, "--member", 1, "--out", tmp_path / "x.onnx")["difference"] < 1e-4
    assert (tmp_path / "x.onnx").exists()
    recorded = run_json(capsys, "record", CORE, "--env", "Hopper-v5", "--out", tmp_path / "x.mcap")
    found = run_json(capsys, "export", tmp_path / "x.mcap", "--minari", "hopper/mine-v0")
    assert found == {"dataset": "hopper/mine-v0", "steps": recorded["episodes"][0]["steps"]}


def test_a_video_is_made_whatever_mujoco_gl_says(short_recording, tmp_path):
    done = run_headless(tmp_path, "-m", "transferkit", "replay", short_recording, "--video", "x.mp4", MUJOCO_GL="nonsense")
    if done.returncode == 0:
        assert (tmp_path / "x.mp4").stat().st_size > 1000
        assert done.stderr == ""
    else:  # a machine without a driver
        assert (done.returncode, done.stderr.count("\n")) == (2, 1)


def test_a_video_that_cannot_be_made(capsys, monkeypatch):
    monkeypatch.setattr("transferkit.renderer._renders", _renders.__wrapped__)  # whatever an earlier test has found
    monkeypatch.delenv("DISPLAY", raising=False)
    monkeypatch.setenv("PYOPENGL_PLATFORM", "nonsense")  # neither EGL nor OSMesa
    said = refusal(capsys, "replay", "x.mcap", "--video", "x.mp4")
    assert "nothing can be rendered here; install a GL driver (Debian: libegl1); `transferkit doctor` checks" in said


def test_another_tools_recording_is_drawn_and_no_command_advises_a_flag_that_it_has_not(capsys, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    write_foreign(tmp_path / "x.mcap")
    (tmp_path / "m.toml").write_text(MAPPING)
    assert "name its channels with --mapping" in refusal(capsys, "plot", "x.mcap")
    assert run(capsys, "plot", "x.mcap", "--mapping", "m.toml")[:2] == (0, "x.png\n")
    for replay in (["replay", "x.mcap"], ["replay", "x.mcap", "--video", "x.mp4"]):
        assert "only its own have the seeds and states that a replay needs; plot it with --mapping" in refusal(capsys, *replay)
    assert "mapping" not in refusal(capsys, "export", "x.mcap", "--minari", "my/x-v0")


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        pytest.param("record nothing-v1 --out x.mcap", "unknown run or core 'nothing-v1'", id="core"),
        pytest.param("record inverted-pendulum-v1 --episodes 0 --out x.mcap", "--episodes=0 must be at least 1", id="episodes"),
        pytest.param("record inverted-pendulum-v1 --out no/x.mcap", "choose an --out in a folder that exists", id="folder"),
        pytest.param("replay nothing.mcap", "cannot read nothing.mcap: No such file", id="replay"),
        pytest.param("replay nothing.mcap --video x.gif", "ending of x.gif='.gif' must be .mp4", id="video"),
        pytest.param("recover nothing.mcap", "cannot read nothing.mcap: No such file", id="recover"),
        pytest.param("plot nothing.mcap", "cannot read nothing.mcap: No such file", id="plot"),
        pytest.param("export a b --out x.onnx", "2 policies do not fit into one file; export them one by one", id="export"),
        pytest.param("export x.mcap --minari mine", "Minari dataset='mine' must be a name with a version", id="dataset"),
        pytest.param(
            "pretrain --env Hopper-v5 --steps 9 --name x --threshold 1 --seeds", "--seeds=() must be at least one", id="seeds"
        ),
        pytest.param("train --env Hopper-v5 --steps 9 --record always", "--record='always' must be every=N", id="record"),
        pytest.param("train --env Hopper-v5 --steps 9 --experience x.mcap", "use --algo dyna-ddpg", id="experience"),
    ],
)
def test_mistakes_are_one_line(capsys, tmp_path, monkeypatch, arguments, message):
    monkeypatch.chdir(tmp_path)
    assert message in refusal(capsys, *arguments.split())
    assert list(tmp_path.iterdir()) == []
