"""No value of MUJOCO_GL stops what renders nothing, on a machine without a display; real processes."""

import os
import subprocess
import sys

import pytest

CARTPOLE, HOPPER = "dm_control/cartpole-balance-v0", "Hopper-v5"
NOTICE = "MUJOCO_GL=nonsense cannot be used and is ignored: invalid value for environment variable MUJOCO_GL: nonsense\n"

STEP_AND_RENDER = f"""
from contextlib import suppress
from transferkit import EnvironmentContractError, make_env

def make(env_id, **options):
    env = make_env(env_id, **options)
    env.reset(seed=0)
    env.step(env.action_space.sample())
    return env

make({CARTPOLE!r}), make({HOPPER!r})
with suppress(EnvironmentContractError):  # nothing can be rendered here
    for env_id in ({CARTPOLE!r}, {HOPPER!r}):
        with make(env_id, render_mode="rgb_array") as env:
            assert len(set(env.render().flat)) > 9, "an empty picture"
with suppress(ImportError):
    import triton  # has an LLVM of its own, which does not go with that of a driver; torch's compiler imports it
"""


def run_headless(folder, *arguments, **variables):
    """Run Python without a display, under a MUJOCO_GL that is only set if it is among the variables."""
    kept = {name: value for name, value in os.environ.items() if name not in {"DISPLAY", "WAYLAND_DISPLAY", "MUJOCO_GL"}}
    command, environment = [sys.executable, *arguments], kept | variables
    return subprocess.run(command, cwd=folder, env=environment, capture_output=True, text=True, check=False)


@pytest.mark.parametrize("renderer", ["egl", "osmesa", "glfw", "disable", "nonsense", None])
def test_environments_step_and_render(renderer, tmp_path):
    done = run_headless(tmp_path, "-c", STEP_AND_RENDER, **({"MUJOCO_GL": renderer} if renderer else {}))
    assert done.returncode == 0, done.stderr
    assert "Traceback" not in done.stderr


@pytest.mark.parametrize(("renderer", "said"), [("egl", ""), ("nonsense", NOTICE)])
def test_training(renderer, said, tmp_path):
    small = ["--steps", "200", "--eval-episodes", "1", "--out", "run", "--json"]
    done = run_headless(tmp_path, "-m", "transferkit", "train", "--env", CARTPOLE, *small, MUJOCO_GL=renderer)
    assert done.returncode == 0, done.stderr
    assert said in done.stderr
    assert done.stderr.count("MUJOCO_GL") == said.count("MUJOCO_GL")
