"""The viewer itself, on a virtual display."""

import contextlib
import json
import os
import shutil
import subprocess
import sys

import pytest

from transferkit import load_subject, play_episodes
from transferkit.errors import EnvironmentContractError
from transferkit.play.viewer import PAUSE
from transferkit.renderer import DISPLAYS

pytestmark = pytest.mark.skipif(shutil.which("Xvfb") is None, reason="no virtual display; apt-get install xvfb")

PLAY = """
import json, sys, time
from contextlib import contextmanager
import transferkit.play.viewer as viewer
from transferkit import load_subject, play_episodes

most, opened, synced = int(sys.argv[1]), [], 0

@contextmanager
def watched(*simulation):
    with viewer_of(*simulation) as handle:
        opened.append(handle)
        count(handle)
        yield handle

def count(handle):
    sync = handle.sync

    def counted():
        global synced
        synced += 1
        assert handle.is_running() and handle.viewport.width > 100
        sync()
        if synced == most:
            handle.close()  # as a click on the window does

    handle.sync = counted

viewer_of, viewer.viewer_of = viewer.viewer_of, watched
subject = load_subject("inverted-pendulum-v1", env="InvertedDoublePendulum-v5")
begin = time.monotonic()
shown = play_episodes(subject, episodes=2, inputs=True)
passed = time.monotonic() - begin
print(json.dumps([[e.steps for e in shown.episodes], shown.whole, shown.inputs, passed, synced, len(opened)]))
assert not any(handle.is_running() for handle in opened)
"""


@pytest.fixture(scope="module")
def display():
    """The name of a virtual display."""
    reading, writing = os.pipe()
    command = ["Xvfb", "-displayfd", str(writing), "-screen", "0", "800x600x24", "-nolisten", "tcp"]
    with contextlib.ExitStack() as stack:
        server = stack.enter_context(subprocess.Popen(command, pass_fds=[writing], stderr=subprocess.DEVNULL))
        stack.callback(server.terminate)
        os.close(writing)
        with os.fdopen(reading) as line:
            yield f":{line.readline().strip()}"


def run_with(display, *arguments):
    environment = {name: value for name, value in os.environ.items() if name != "MUJOCO_GL"} | {"DISPLAY": display}
    command = [sys.executable, *map(str, arguments)]
    return subprocess.run(command, env=environment, capture_output=True, text=True, check=False, timeout=300)


def shown(display, most):
    done = run_with(display, "-c", PLAY, most)
    assert (done.returncode, done.stderr) == (0, "")
    return json.loads(done.stdout)


def test_it_plays_in_real_time_until_the_episodes_are_over(display):
    steps, whole, inputs, passed, synced, opened = shown(display, -1)
    assert (len(steps), whole, inputs, opened) == (2, True, "core input", 1)
    assert passed > 2 * PAUSE + 0.05 * sum(steps)  # its control step
    assert synced >= 4


def test_it_ends_when_the_window_is_closed(display):
    steps, whole, _, _, synced, _ = shown(display, 2)
    assert (len(steps), whole, synced) == (1, False, 2)


def test_the_command_opens_it_and_writes_nothing(display, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    done = run_with(display, "-m", "transferkit", "play", "inverted-pendulum-v1", "--env", "InvertedDoublePendulum-v5")
    assert done.stdout.startswith("shown in MuJoCo's viewer; 1 episode, ")
    assert (done.returncode, done.stderr, list(tmp_path.iterdir())) == (0, "", [])
    done = run_with(display, "-m", "transferkit", "play", "inverted-pendulum-v1", "--seconds", 3)
    assert (done.returncode, done.stderr.count("\n")) == (2, 1)
    assert "--seconds is of a file, and the viewer shows whole episodes" in done.stderr


def test_without_a_display_it_is_refused_in_one_line(monkeypatch):
    for name in DISPLAYS:
        monkeypatch.delenv(name, raising=False)
    with pytest.raises(EnvironmentContractError, match="MuJoCo's viewer cannot open: no display; make a video"):
        play_episodes(load_subject("inverted-pendulum-v1"))
