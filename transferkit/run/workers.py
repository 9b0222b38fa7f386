"""Several runs at a time."""

from __future__ import annotations

import multiprocessing
import os
import signal
import threading
from concurrent.futures import ProcessPoolExecutor


def worker_pool(workers: int) -> ProcessPoolExecutor:
    """Fresh processes that save and stop when their parent is gone, so that the next call finds their runs free."""
    return ProcessPoolExecutor(workers, multiprocessing.get_context("spawn"), initializer=_stop_with_parent)


def _stop_with_parent() -> None:
    parent = multiprocessing.parent_process()
    assert parent is not None

    def watch() -> None:
        parent.join()
        os.kill(os.getpid(), signal.SIGTERM)

    threading.Thread(target=watch, daemon=True).start()
