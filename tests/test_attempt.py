import pytest

from transferkit.attempt import attempt


@pytest.mark.parametrize(
    ("code", "output", "failure"),
    [
        pytest.param("import os, sys; print('a'); print(os.environ['MUJOCO_GL'], sys.argv[1])", "egl x", "", id="succeeds"),
        pytest.param("print('a', flush=True); raise ValueError('wrong')", "a", "ValueError: wrong", id="raises"),
        pytest.param("raise SystemExit(3)", "", "exit status 3", id="says nothing"),
        pytest.param("import os; os.kill(os.getpid(), 11)", "", "killed by signal 11", id="crashes"),
        pytest.param(
            "import os; os.write(1, b'\\xff'); os.write(2, b'\\n\\xff\\n'); exit(1)", "\ufffd", "\ufffd", id="no text"
        ),
    ],
)
def test_an_attempt_survives_what_it_runs(code, output, failure):
    assert attempt(code, "x", renderer="egl") == (output, failure)


def test_an_attempt_ends():
    assert attempt("import time; print('a', flush=True); time.sleep(60)", seconds=1.0) == ("a", "not done after 1 s")
