"""Forked processes: everything a job needs is imported once, before."""

from __future__ import annotations

import importlib
import os
import signal
import sys
import tempfile
import time
import traceback
import warnings
from collections.abc import Callable, Collection
from pathlib import Path

import torch

from transferkit.export import export_onnx
from transferkit.subject import load_subject

PATIENCE = 300.0
"""Seconds after which a process is given up."""


NEEDED = ("torch.utils.tensorboard", "transferkit.trainers.dyna.trainer", "transferkit.trainers.ppo.trainer")
"""Modules that are imported when a policy is trained."""
NEEDED_BY = {
    "train": "transferkit.cli.train",
    "pretrain": "transferkit.cli.pretrain",
    "plot": "transferkit.plots",
    "report": "experiments.report.write",
}
"""And by what some jobs do."""


def warm_up(names: Collection[str]) -> None:
    """Import what these jobs need, so that a forked process has it from the start; an export imports when it runs."""
    warnings.simplefilter("ignore")
    torch.set_num_threads(1)
    for module in (*NEEDED, *(module for name, module in NEEDED_BY.items() if name in names)):
        importlib.import_module(module)
    if "export" in names:
        with tempfile.TemporaryDirectory() as scratch:
            export_onnx(load_subject("inverted-pendulum-v1", values=False), Path(scratch) / "policy.onnx")


def start(work: Callable[[], int | None], output: Path, errors: Path | None = None) -> int:
    """Do some work in a forked process that exits with what it returns; its output is appended to files."""
    sys.stdout.flush()
    child = os.fork()
    if child:
        return child
    code = 1
    try:
        for number, path in ((1, output), (2, errors or output)):
            os.dup2(os.open(path, os.O_WRONLY | os.O_CREAT | os.O_APPEND), number)
        sys.stdout, sys.stderr = open(1, "w"), open(2, "w")  # noqa: SIM115 - whoever captures the parent's has no part in it
        code = work() or 0
    except BaseException:  # the parent's own code must not go on here
        traceback.print_exc()
    finally:
        sys.stdout.flush()
        sys.stderr.flush()
        os._exit(code)


def wait(child: int) -> int:
    """The exit code of a process, negative after a signal."""
    deadline = time.monotonic() + PATIENCE
    while True:
        done, status = os.waitpid(child, os.WNOHANG)
        if done:
            return os.waitstatus_to_exitcode(status)
        if time.monotonic() > deadline:
            os.kill(child, signal.SIGKILL)
        time.sleep(0.002)
