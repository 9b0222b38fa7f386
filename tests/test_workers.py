import os
import signal
import subprocess
import sys
import threading
import time

import pytest

from transferkit.errors import SettingError
from transferkit.workers import GRACE, _held_interrupts, worker_pool

PARENT = """
import os, sys, time
from transferkit.workers import import_beside, worker_pool

def has_it():
    return "colorsys" in sys.modules

if __name__ == "__main__":
    import_beside("colorsys")
    with worker_pool(1, 1) as pool:
        print(has_it(), pool.submit(has_it).result(), flush=True)
        print(pool.submit(os.getpid).result(), flush=True)
        pool.submit(time.sleep, 600).result()
"""

SAVING = """
import signal, sys, time
from pathlib import Path
from transferkit.workers import worker_pool

asked = []

def save():
    signal.signal(signal.SIGTERM, lambda *_: asked.append(True))
    Path("busy").touch()
    while not asked:
        time.sleep(0.05)
    Path("saved").touch()

if __name__ == "__main__":
    signal.signal(signal.SIGINT, signal.default_int_handler)  # a shell's background jobs ignore it
    with worker_pool(1, 1) as pool:
        run = pool.submit(save)
        pool.submit(time.sleep, 600)  # at hand already: it does not begin
        while not Path("busy").exists():
            time.sleep(0.05)
        signal.raise_signal(signal.SIGINT)
"""


def alive(pid):
    try:
        with open(f"/proc/{pid}/stat") as file:
            return file.read().rsplit(")", 1)[1].split()[0] != "Z"
    except FileNotFoundError:
        return False


def test_workers_have_what_was_imported_beside_and_end_when_their_parent_is_killed(tmp_path):
    script = tmp_path / "parent.py"
    script.write_text(PARENT)
    parent = subprocess.Popen([sys.executable, str(script)], stdout=subprocess.PIPE, text=True)
    assert parent.stdout.readline() == "False True\n"
    worker = int(parent.stdout.readline())
    assert alive(worker)
    os.kill(parent.pid, signal.SIGKILL)
    parent.wait()
    deadline = time.monotonic() + 10
    while alive(worker) and time.monotonic() < deadline:
        time.sleep(0.05)
    assert not alive(worker)


def test_a_worker_ends_as_soon_as_its_run_is_saved(tmp_path):
    (tmp_path / "parent.py").write_text(SAVING)
    started = time.monotonic()
    command = [sys.executable, "parent.py"]
    ended = subprocess.run(command, cwd=tmp_path, capture_output=True, text=True, check=False, timeout=60)
    assert "stopped; what was learnt is saved" in ended.stderr
    assert "resource_tracker" not in ended.stderr
    assert (tmp_path / "saved").exists()
    assert time.monotonic() - started < GRACE


def test_a_ctrl_c_waits_also_where_another_thread_gets_it():
    over = threading.Event()
    threading.Thread(target=over.wait).start()  # takes the signal that the main thread masks
    steps = []

    def start():
        os.kill(os.getpid(), signal.SIGINT)
        time.sleep(0.1)
        steps.append("afterwards")

    before = signal.signal(signal.SIGINT, signal.default_int_handler)  # a shell's background jobs ignore it
    try:
        with pytest.raises(KeyboardInterrupt), _held_interrupts():
            start()
    finally:
        signal.signal(signal.SIGINT, before)
        over.set()
    assert steps == ["afterwards"]


def test_a_pool_has_at_least_one_worker_and_no_more_than_jobs():
    with pytest.raises(SettingError, match=r"^workers=0 must be at least 1"), worker_pool(0, 1):
        pass
    with worker_pool(2**40, 1) as pool:
        assert pool.submit(int).result() == 0
