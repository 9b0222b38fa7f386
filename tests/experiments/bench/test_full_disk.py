"""Every command that writes, on a disk that is too small for it and then has room."""

import subprocess
import sys

from experiments.bench.full_disk.trial import _judge

SIZES = {"train": (16, 64), "record": (4, 128), "matrix": (4, 64), "pretrain": (64,)}
SIZES |= {"report": (64,), "export": (4,), "plot": (4,)}
"""In kB: before and after the first checkpoint, whole step or finished run."""


def test_a_full_disk_is_one_line_and_the_command_goes_on_once_there_is_room():
    command = [sys.executable, "-m", "experiments.bench", "full-disk", "--commands"]
    command += [f"{name}:{','.join(map(str, sizes))}" for name, sizes in SIZES.items()]
    done = subprocess.run(command, capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stdout + done.stderr
    rows = {line.split()[0]: line.split()[1:] for line in done.stdout.splitlines()[2:]}
    assert rows == {name: [str(len(sizes)), str(len(sizes)), "0"] for name, sizes in SIZES.items()}


def test_what_is_wrong_with_a_failure_is_found():
    good = "transferkit: cannot write a: No space left on device; make room on the disk\n"
    assert _judge(2, good) == []
    assert _judge(2, f"1 of 3, 0 min left: a cell\n{good}") == []
    assert _judge(1, good) == ["exit code 1"]
    assert _judge(2, good * 2)[0].startswith("2 lines instead of one")
    assert _judge(2, "transferkit: [Errno 28] No space left on device\n")[0].startswith("unclear")
