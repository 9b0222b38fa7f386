"""Versions and git state, which a result depends on besides its configuration."""

from __future__ import annotations

import functools
import os
import platform
import shlex
import shutil
import subprocess
import sys
from importlib import metadata
from pathlib import Path

PACKAGES = (
    "transferkit",
    "mujoco",
    "dm-control",
    "gymnasium",
    "shimmy",
    "torch",
    "rsl-rl-lib",
    "numpy",
    "scipy",
    "safetensors",
)

NOT_INSTALLED = "not installed"


def versions() -> dict[str, str]:
    """Look up the installed version of every package that can change a number, and of Python."""
    return {"python": platform.python_version()} | {name: _version(name) for name in PACKAGES}


def command() -> str:
    """Return the command line of this process, without the path of the program."""
    program = Path(sys.argv[0]).name
    return shlex.join(["transferkit" if program == "__main__.py" else program, *sys.argv[1:]])


def git_state() -> dict[str, str | bool] | None:
    """Find the commit of the checkout that transferkit runs from and whether it has changes; None outside a checkout."""
    root = Path(__file__).resolve().parents[1]
    if not (root / ".git").exists():
        return None
    try:
        commit = _git(root, "rev-parse", "HEAD")
        return {"commit": commit, "dirty": bool(_git(root, "status", "--porcelain", "--untracked-files=no"))}
    except (OSError, subprocess.CalledProcessError):
        return None


def _git(root: Path, *args: str) -> str:
    return subprocess.run(["git", "-C", str(root), *args], capture_output=True, text=True, check=True).stdout.strip()


@functools.cache
def _version(name: str) -> str:
    try:
        return metadata.version(name) or NOT_INSTALLED  # None of what is half removed
    except metadata.PackageNotFoundError:
        return NOT_INSTALLED


def cpp_compiler() -> str | None:
    """Find the C++ compiler that torch compiles updates with: `CXX`, or g++."""
    return shutil.which(os.environ.get("CXX", "g++"))
