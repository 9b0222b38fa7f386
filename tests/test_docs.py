"""The blocks of a page run as they are written, one after the other."""

import re
import shlex
import sys
from pathlib import Path

import pytest

from transferkit.cli.main import main

PAGES = Path(__file__).parents[1] / "docs"
BLOCK = re.compile(r"(?ms)^```(?:\{code-block\} )?(python|sh)\n(?::caption: (\S+)\n)?(.*?)^```$")


@pytest.mark.parametrize("page", ["own_environment.md"])
def test_the_blocks_of_a_page_run(page, tmp_path, monkeypatch, capsys):
    monkeypatch.chdir(tmp_path)
    monkeypatch.syspath_prepend(tmp_path)
    names = {}
    blocks = BLOCK.findall((PAGES / page).read_text())
    assert {kind for kind, _, _ in blocks} == {"python", "sh"}
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
    assert out.count("(1000.0, 1000.0)") == 4
    assert "hinge_y.velocity[t-1]" in out
    assert "reproduced to the bit" in out
