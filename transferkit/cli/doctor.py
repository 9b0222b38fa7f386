"""`transferkit doctor`."""

from __future__ import annotations

import os
import shutil
import subprocess
import sys
from collections.abc import Sequence
from pathlib import Path
from typing import Any

from transferkit.cli.answer import Answer, parser
from transferkit.table import format_table
from transferkit.versions import git_state, versions

RENDER = (
    "import mujoco; m = mujoco.MjModel.from_xml_string('<mujoco><worldbody><geom size=\".1\"/></worldbody></mujoco>');"
    "d = mujoco.MjData(m); mujoco.mj_forward(m, d); r = mujoco.Renderer(m, 16, 16); r.update_scene(d); r.render()"
)
GL_TIMEOUT = 60


def main(arguments: Sequence[str]) -> Answer:
    """Check the installation; exit code 2 if something must be mended."""
    parser("doctor", "Check this installation and say what to mend.").parse_args(arguments)
    report = examine()
    text = "\n".join(
        (
            format_table(("package", "version"), list(report["versions"].items())),
            f"\nrendering: {report['rendering']}\nCUDA: {report['cuda']}\ncores: {report['cores']}\ngit: {report['git']}",
            "\n".join(f"mend: {problem}" for problem in report["problems"]) or "\nnothing to mend",
        )
    )
    return Answer(report, text, 2 if report["problems"] else 0)


def examine() -> dict[str, Any]:
    """Report versions, rendering, devices, git, and what is wrong with them."""
    import torch  # noqa: PLC0415 - takes seconds to import

    return {
        "versions": versions(),
        "rendering": _rendering(),
        "cuda": torch.version.cuda if torch.cuda.is_available() else "none; --device cpu",
        "cores": f"{os.cpu_count()}, of which a training run uses one (one torch thread a process)",
        "git": git_state() or ("not a checkout" if shutil.which("git") else "no git binary; runs record no commit"),
        "problems": known_problems(versions(), _mujoco_libraries()),
    }


def known_problems(installed: dict[str, str], libraries: Sequence[str]) -> list[str]:
    """Find version pairs that are known to fail, each with its fix."""
    problems = []
    mujoco = tuple(int(part) for part in installed["mujoco"].split(".")[:2] if part.isdigit())
    if mujoco and not (3, 17) <= mujoco < (4, 0):
        problems.append(
            f"mujoco {installed['mujoco']} does not work with dm-control: pip install 'mujoco>=3.17,<4' in a new venv"
        )
    if len(libraries) > 1:
        problems.append(f"two libraries of mujoco are installed ({', '.join(libraries)}): make a new virtual environment")
    rsl_rl = installed["rsl-rl-lib"].split(".")
    if rsl_rl[0].isdigit() and (int(rsl_rl[0]), int(rsl_rl[1])) < (5, 5):
        problems.append(f"rsl-rl-lib {installed['rsl-rl-lib']} is too old: pip install 'rsl-rl-lib>=5.5,<6'")
    problems += [f"{name} is missing: pip install {name}" for name, version in installed.items() if version == "not installed"]
    return problems


def _mujoco_libraries() -> list[str]:
    import mujoco  # noqa: PLC0415

    return sorted(path.name for path in Path(mujoco.__file__).parent.glob("libmujoco.so.*"))


def _rendering() -> str:
    """Try each backend in a process of its own: it is chosen before mujoco is imported, and a bad one can abort."""
    for backend in dict.fromkeys((os.environ.get("MUJOCO_GL", "egl"), "egl", "osmesa")):
        environment = {**os.environ, "MUJOCO_GL": backend}
        try:
            probe = subprocess.run(
                [sys.executable, "-c", RENDER], env=environment, capture_output=True, timeout=GL_TIMEOUT, check=False
            )
        except subprocess.TimeoutExpired:
            continue
        if probe.returncode == 0:
            return f"works with MUJOCO_GL={backend}"
    return "none (training needs none); for pictures: apt-get install libegl1, then MUJOCO_GL=egl"
