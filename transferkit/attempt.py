"""Python code that is tried in a process of its own, which it may crash or hold up."""

from __future__ import annotations

import os
import subprocess
import sys
from typing import NamedTuple

SECONDS = 60.0
"""That an attempt may take."""


class Attempt(NamedTuple):
    """How the code ended."""

    output: str
    """The last line that it printed."""
    failure: str
    """One line; empty if it succeeded."""


def attempt(code: str, *arguments: str, renderer: str = "disable", seconds: float = SECONDS) -> Attempt:
    """Run code under a value of MUJOCO_GL, for so long at most."""
    command, environment = [sys.executable, "-P", "-c", code, *arguments], os.environ | {"MUJOCO_GL": renderer}
    try:
        done = subprocess.run(command, env=environment, capture_output=True, timeout=seconds, check=False)
    except subprocess.TimeoutExpired as error:
        return Attempt(_last_line(error.stdout), f"not done after {seconds:g} s")
    return Attempt(_last_line(done.stdout), _failure(done.returncode, done.stderr))


def _failure(status: int, stderr: bytes) -> str:
    if status < 0:
        return f"killed by signal {-status}"
    return (_last_line(stderr) or f"exit status {status}") if status else ""


def _last_line(output: bytes | None) -> str:
    lines = (output or b"").decode(errors="replace").strip().splitlines()
    return lines[-1] if lines else ""
