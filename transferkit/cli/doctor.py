"""`transferkit doctor`, which works when nothing else does: what may crash runs in a process of its own."""

from __future__ import annotations

import os
import re
import shutil
from collections.abc import Sequence
from importlib import util
from pathlib import Path
from typing import Any

from transferkit.attempt import attempt
from transferkit.cli.answer import Answer, parser
from transferkit.renderer import find_renderer
from transferkit.table import format_table
from transferkit.versions import NOT_INSTALLED, cpp_compiler, git_state, versions

MODULES = {
    "numpy": "numpy",
    "scipy": "scipy",
    "safetensors": "safetensors",
    "torch": "torch",
    "mujoco": "mujoco",
    "gymnasium": "gymnasium",
    "dm_control.suite": "dm-control",
    "shimmy.dm_control_compatibility": "shimmy",
    "rsl_rl.algorithms": "rsl-rl-lib",
}
"""What is imported, each after what it imports itself, and the package that it belongs to."""

ROWS = (("rendering", "rendering"), ("CUDA", "cuda"), ("cores", "cores"), ("compiler", "compiler"), ("git", "git"))
"""Lines below the versions, and their keys in the JSON."""

IMPORT = """
import importlib, sys
for name in sys.argv[1:]:
    print(name, flush=True)
    importlib.import_module(name)
print("torch", flush=True)
import torch
print(torch.version.cuda if torch.cuda.is_available() else "none; --device cpu")
"""
IMPORT_SECONDS = 300.0  # from a cold disk, on a busy machine


def _told(found: object) -> str:
    """A line's text; of a checkout its commit."""
    if isinstance(found, dict):
        return f"{found['commit']}{', with changes' if found['dirty'] else ''}"
    return "none" if found is None else str(found)


def main(arguments: Sequence[str]) -> Answer:
    """Check the installation; exit code 2 if something must be mended."""
    parser("doctor", "Check this installation and say what to mend.").parse_args(arguments)
    report = examine()
    text = "\n".join(
        (
            format_table(("package", "version"), list(report["versions"].items())),
            "\n" + "\n".join(f"{name}: {_told(report[key])}" for name, key in ROWS),
            "\n".join(f"mend: {problem}" for problem in report["problems"]) or "\nnothing to mend",
        )
    )
    return Answer(report, text, 2 if report["problems"] else 0)


def examine() -> dict[str, Any]:
    """Report versions, rendering, devices, git, and what is wrong with them."""
    installed = versions()
    problems = known_problems(installed, _mujoco_libraries())
    cuda, failure = attempt(IMPORT, *MODULES, seconds=IMPORT_SECONDS)
    if failure:
        package, cuda = MODULES.get(cuda, cuda), "unknown"
        if installed.get(package) != NOT_INSTALLED:
            problems.append(f"{package} cannot be imported ({failure}): pip install --force-reinstall {package}")
    return {
        "versions": installed,
        "rendering": _rendering(),
        "cuda": cuda,
        "cores": f"{os.cpu_count()}, of which a training run uses one (one torch thread a process)",
        "compiler": cpp_compiler() or "no C++ compiler; updates are not compiled, which would be faster: apt-get install g++",
        "git": git_state() or ("not a checkout" if shutil.which("git") else "no git binary; runs record no commit"),
        "problems": problems,
    }


def known_problems(installed: dict[str, str], libraries: Sequence[str]) -> list[str]:
    """Find version pairs that are known to fail, each with its fix."""
    problems = []
    mujoco, rsl_rl = _numbers(installed["mujoco"]), _numbers(installed["rsl-rl-lib"])
    if mujoco and not (3, 17) <= mujoco < (4, 0):
        problems.append(
            f"mujoco {installed['mujoco']} does not work with dm-control: pip install 'mujoco>=3.17,<4' in a new venv"
        )
    if len(libraries) > 1:
        problems.append(f"two libraries of mujoco are installed ({', '.join(libraries)}): make a new virtual environment")
    if rsl_rl and rsl_rl < (5, 5):
        problems.append(f"rsl-rl-lib {installed['rsl-rl-lib']} is too old: pip install 'rsl-rl-lib>=5.5,<6'")
    problems += [f"{name} is missing: pip install {name}" for name, version in installed.items() if version == NOT_INSTALLED]
    return problems


def _numbers(version: str) -> tuple[int, ...]:
    """Read a version's first two numbers; none of a package that is not installed."""
    return tuple(int(number) for number in re.findall(r"\d+", version)[:2])


def _mujoco_libraries() -> list[str]:
    spec = util.find_spec("mujoco")
    folders = (spec and spec.submodule_search_locations) or ()
    return sorted(path.name for folder in folders for path in Path(folder).glob("libmujoco.so.*"))


def _rendering() -> str:
    renderer = find_renderer()
    if renderer is not None:
        return f"works with MUJOCO_GL={renderer}"
    return "none (training needs none); for pictures: apt-get install libegl1, then MUJOCO_GL=egl"
