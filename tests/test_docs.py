"""The blocks of a page run as they are written, one after the other."""

import re
import shlex
import sys
from pathlib import Path

import pytest

from transferkit.cli.main import main

PAGES = Path(__file__).parents[1] / "docs"
BLOCK = re.compile(r"(?ms)^```(?:\{code-block\} )?(python|sh|yaml)\n(?::caption: (\S+)\n)?(.*?)^```$")


SAID = {
    "bring_your_policy.md": [
        "zoo/pole-v1: Stable-Baselines3",
        "pole-v1: hashes, schema and probe outputs fit",
        "joint position foot_joint   position of thigh_joint  order",
    ],
    "own_environment.md": ["hinge_y.velocity[t-1]", "reproduced to the bit"],
    "deploy.md": ["cheetah_leapp.yaml with cheetah_leapp.onnx", "cheetah_io.yaml", "the cheetah is at", "zoo/blind-v1: return"],
    "zoo.md": ["shared_zoo; its index now has the digest", "core_zoo/inverted-pendulum-v1", "is forgotten; what was pulled"],
    "matching.md": [
        "joint hinge_y2 (thigh_joint) = -1 hip",
        "two_poles.yaml: edit it",
        "+0.25 atan2(hinge_y2.sin, hinge_y2.cos)",
    ],
}
"""Pages, and what their blocks print among other things."""


@pytest.mark.parametrize("page", SAID)
def test_the_blocks_of_a_page_run(page, tmp_path, monkeypatch, capsys):
    monkeypatch.chdir(tmp_path)
    monkeypatch.syspath_prepend(tmp_path)
    monkeypatch.setenv("XDG_CONFIG_HOME", str(tmp_path / "config"))
    names = {}
    blocks = BLOCK.findall((PAGES / page).read_text())
    assert {kind for kind, _, _ in blocks} >= {"python", "sh"}
    for kind, file, code in blocks:
        if file:
            Path(file).write_text(code)
        elif kind == "python":
            exec(compile(code, page, "exec"), names)
        else:
            for line in code.replace("\\\n", " ").splitlines():
                program, *arguments = shlex.split(line)
                assert program == "transferkit"
                assert main(arguments) == 0, capsys.readouterr().err
    for name in ("my_robots", "my_cart"):
        sys.modules.pop(name, None)
    out = capsys.readouterr().out
    assert out.count("(1000.0, 1000.0)") == (4 if page == "own_environment.md" else 0)
    assert [text for text in SAID[page] if text not in out] == []
