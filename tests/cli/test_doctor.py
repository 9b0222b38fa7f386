import json

import pytest

from tests.cli.commands import run
from tests.test_physics import run_headless
from transferkit.cli.doctor import MODULES, known_problems

FINE = dict.fromkeys(MODULES.values(), "1.0") | {"mujoco": "3.17.0", "rsl-rl-lib": "5.5.0"}


@pytest.mark.parametrize("renderer", ["egl", "osmesa", "nonsense"])
def test_any_value_of_mujoco_gl(renderer, tmp_path):
    done = run_headless(tmp_path, "-m", "transferkit", "doctor", "--json", MUJOCO_GL=renderer)
    assert (done.returncode, done.stderr) == (0, "")
    report = json.loads(done.stdout)
    assert report["rendering"].startswith(("works with MUJOCO_GL=", "none"))
    assert report["versions"]["mujoco"]
    assert report["problems"] == []


def test_a_package_that_cannot_be_imported(capsys, monkeypatch, tmp_path):
    (tmp_path / "torch.py").write_text("raise ImportError('libc10.so: no such file')")
    monkeypatch.setenv("PYTHONPATH", str(tmp_path))
    code, out, err = run(capsys, "doctor")
    assert (code, err) == (2, "")
    assert "mend: torch cannot be imported (ImportError: libc10.so: no such file): pip install --force-reinstall torch" in out
    assert "CUDA: unknown" in out


@pytest.mark.parametrize(
    ("installed", "problem"),
    [
        ({"rsl-rl-lib": "5"}, "rsl-rl-lib 5 is too old"),
        ({"rsl-rl-lib": "5.4rc1"}, "rsl-rl-lib 5.4rc1 is too old"),
        ({"mujoco": "3.16.1"}, "mujoco 3.16.1 does not work with dm-control"),
        ({"torch": "not installed"}, "torch is missing: pip install torch"),
    ],
)
def test_known_problems(installed, problem):
    assert known_problems(FINE, ["libmujoco.so.3.17.0"]) == []
    (found,) = known_problems(FINE | installed, ())
    assert found.startswith(problem)
