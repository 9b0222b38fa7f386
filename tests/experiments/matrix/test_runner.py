import csv
import errno
import os
import signal
import subprocess
import sys
import time

import pytest

from experiments.bench.kills.jobs import no_pool
from experiments.matrix import runner
from experiments.matrix.__main__ import main
from experiments.matrix.cell_folder import ERROR, Failure, folder
from experiments.matrix.grid_toml import load_cells
from experiments.matrix.results import EVALUATIONS, TABLE, collect, read_results
from experiments.matrix.runner import FullDiskError, run_cell
from transferkit.files import read_json, write_json, writing


def table(out, name=TABLE):
    with (out / name).open() as file:
        return [{key: value for key, value in row.items() if key != "seconds"} for row in csv.DictReader(file)]


def heed_interrupts():
    """A shell's background job ignores Ctrl-C, and so would what it starts."""
    signal.signal(signal.SIGINT, signal.SIG_DFL)


def start(grid, out):
    command = [sys.executable, "-m", "experiments.matrix", str(grid), "--out", str(out), "--workers", "1"]
    quiet = {"stdout": subprocess.DEVNULL, "stderr": subprocess.PIPE, "text": True}
    return subprocess.Popen(command, preexec_fn=heed_interrupts, **quiet)  # noqa: PLW1509 - of a single thread


def wait_for(out, pattern):
    deadline = time.monotonic() + 120
    while not list(out.glob(pattern)) and time.monotonic() < deadline:
        time.sleep(0.05)


def test_a_killed_matrix_goes_on_to_the_same_table(grid, tmp_path):
    path = grid()
    start(path, tmp_path / "whole").wait(timeout=120)
    killed = start(path, tmp_path / "killed")
    wait_for(tmp_path / "killed", "cells/*/run/result.json")
    killed.send_signal(signal.SIGKILL)
    killed.wait()
    assert not (tmp_path / "killed" / TABLE).exists()
    again = start(path, tmp_path / "killed")
    assert again.wait(timeout=120) == 0, again.stderr.read()
    assert table(tmp_path / "killed") == table(tmp_path / "whole")
    assert table(tmp_path / "killed", EVALUATIONS) == table(tmp_path / "whole", EVALUATIONS)
    assert len(table(tmp_path / "whole")) == 7


def test_ctrl_c_says_that_the_same_command_goes_on(grid, tmp_path):
    running = start(grid("steps = 150", "steps = 100000"), tmp_path / "out")
    wait_for(tmp_path / "out", "cells/*/run/run.json")
    running.send_signal(signal.SIGINT)
    assert running.wait(timeout=60) == 130
    assert running.stderr.read().strip().endswith("the same command goes on")


def test_a_failed_cell_is_reported_and_tried_again(grid, tmp_path):
    cell = load_cells(grid())[0]
    outcome = run_cell(cell, tmp_path, "test", train=lambda *_, **__: 1 / 0)
    assert str(outcome).endswith("seed 0 FAILED: ZeroDivisionError: division by zero")
    error = folder(tmp_path, cell) / ERROR
    assert read_json(error, Failure) == Failure("ZeroDivisionError", "division by zero")
    assert collect(tmp_path) == []
    (failed,) = read_results(tmp_path).failed
    assert (failed.error_kind, failed.error) == ("ZeroDivisionError", "division by zero")
    assert table(tmp_path)[0]["error_kind"] == "ZeroDivisionError"
    assert run_cell(cell, tmp_path, "test").error == ""
    assert not error.exists()
    assert collect(tmp_path)[0].arm == "transfer"


def test_a_full_disk_ends_the_matrix_and_is_no_fault_of_the_run(grid, tmp_path, monkeypatch, capsys):
    def train(*_, **__):
        with writing(tmp_path / "x"):
            raise OSError(errno.ENOSPC, os.strerror(errno.ENOSPC))

    path = grid('arms = ["transfer", "scratch", "random", "zero-action"]', 'arms = ["transfer"]')
    cell = load_cells(path)[0]
    with pytest.raises(FullDiskError, match=r"cannot write .*x: No space left on device.*; make room on the disk"):
        run_cell(cell, tmp_path, "test", train=train)
    assert not (folder(tmp_path, cell) / ERROR).exists()
    monkeypatch.setattr(runner, "worker_pool", no_pool)
    monkeypatch.setattr(runner, "plan", lambda *_: "")
    monkeypatch.setattr(runner.run_cell, "__kwdefaults__", {"train": train})
    assert main([str(path), "--out", str(tmp_path / "out")]) == 2
    assert capsys.readouterr().err.endswith("make room on the disk; the same command goes on\n")


def test_known_cells_get_the_names_that_the_grid_has_now(grid, tmp_path):
    text = '[[trainer]]\nname = "first"\n[[part]]\narms = ["scratch"]\nseeds = [0]\n'
    assert main([str(grid(more=text)), "--out", str(tmp_path), "--workers", "1"]) == 0
    assert main([str(grid(more=text.replace("first", "second"))), "--out", str(tmp_path), "--workers", "1"]) == 0
    assert [row["trainer"] for row in table(tmp_path)] == ["second"]


def test_what_cannot_be_written_or_reached_is_one_line(grid, tmp_path, capsys):
    (tmp_path / "file").touch()
    for more, message in (
        ([str(tmp_path / "file")], f"{tmp_path}/file is not a folder; choose another --out"),
        (["/proc/none"], "/proc/none cannot be written (No such file or directory); choose another --out"),
        ([str(tmp_path / "out"), "--ray", "nonsense"], "--ray='nonsense' must be auto, HOST:PORT or ray://HOST:PORT"),
        ([str(tmp_path / "out"), "--workers", "0"], "--workers=0 must be at least 1"),
    ):
        assert main([str(grid()), "--out", *more]) == 2
        assert capsys.readouterr().err == f"error: {message}\n"
    assert not (tmp_path / "out").exists()


def test_what_takes_long_to_import_waits_until_ctrl_c_is_heeded():
    modules = "experiments.matrix.__main__, experiments.report.__main__"
    code = f"import sys, {modules}; sys.exit(bool({{'torch', 'numpy'}} & {{*sys.modules}}))"
    subprocess.run([sys.executable, "-c", code], check=True, timeout=60)


def test_another_core_of_the_same_name_is_not_what_ran(full_core_folder, grid, tmp_path, capsys):
    path = grid('cores = ["inverted-pendulum-v1"]', f'cores = ["{full_core_folder}"]')
    (cell, *_) = [cell for cell in load_cells(path) if cell.arm == "transfer"]
    assert run_cell(cell, tmp_path / "out", "test").error == ""
    assert main([str(path), "--out", str(tmp_path / "out"), "--dry-run"]) == 0
    record = folder(tmp_path / "out", cell) / "run" / "run.json"
    said = read_json(record, dict)
    write_json(record, {**said, "config": {**said["config"], "core_digest": "0" * 64}})
    assert main([str(path), "--out", str(tmp_path / "out"), "--dry-run"]) == 2
    assert f"was run around another core with the name {full_core_folder}; choose another --out" in capsys.readouterr().err
