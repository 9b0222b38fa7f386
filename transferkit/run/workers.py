"""Several runs at a time."""

from __future__ import annotations

import multiprocessing
import os
import signal
import sys
import threading
import time
from collections.abc import Iterator, Sequence
from concurrent.futures import ProcessPoolExecutor
from contextlib import contextmanager
from multiprocessing.process import BaseProcess

GRACE = 15.0
"""Seconds that a worker has to save its run once its parent is gone."""


@contextmanager
def worker_pool(workers: int, jobs: int) -> Iterator[ProcessPoolExecutor]:
    """Fresh processes, no more than jobs, that save and stop when their parent is gone: the next call finds their runs free.

    Ctrl-C ends the calling process with status 130.
    """
    with ProcessPoolExecutor(workers, multiprocessing.get_context("spawn"), initializer=_stop_with_parent) as pool:
        try:
            signal.pthread_sigmask(signal.SIG_BLOCK, {signal.SIGINT})  # which workers that still import inherit
            for _ in range(min(workers, jobs)):
                pool.submit(int)  # starts a process
            signal.pthread_sigmask(signal.SIG_UNBLOCK, {signal.SIGINT})  # a Ctrl-C that came meanwhile is heeded here
            yield pool
        except KeyboardInterrupt:
            _stop(multiprocessing.active_children())
            print("stopped; what the workers had is saved, and the same command goes on", file=sys.stderr)
            raise SystemExit(130) from None


def _stop(children: Sequence[BaseProcess]) -> None:
    for child in children:
        child.terminate()
    deadline = time.monotonic() + GRACE
    for child in children:
        child.join(max(0.0, deadline - time.monotonic()))
        child.kill()


def _stop_with_parent() -> None:
    os.setsid()  # a Ctrl-C is for the parent
    signal.pthread_sigmask(signal.SIG_UNBLOCK, {signal.SIGINT})
    parent = multiprocessing.parent_process()
    assert parent is not None

    def watch() -> None:
        parent.join()
        os.kill(os.getpid(), signal.SIGTERM)
        time.sleep(GRACE)
        os.kill(os.getpid(), signal.SIGKILL)

    threading.Thread(target=watch, daemon=True).start()
