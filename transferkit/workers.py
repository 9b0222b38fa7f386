"""Several runs at a time."""

from __future__ import annotations

import multiprocessing
import os
import signal
import threading
import time
from collections.abc import Callable, Iterator, Sequence
from concurrent.futures import Future, ProcessPoolExecutor
from contextlib import contextmanager
from multiprocessing import forkserver, resource_tracker
from multiprocessing.process import BaseProcess
from multiprocessing.synchronize import Event
from typing import Annotated, ParamSpec, TypeVar

from transferkit.config.checks import AT_LEAST_ONE, check_value
from transferkit.errors import InterruptedRunError

P = ParamSpec("P")
R = TypeVar("R")

GRACE = 15.0
"""Seconds that a worker has to save its run once its parent is gone."""


_CONTEXT = multiprocessing.get_context("forkserver")

_stopping: Event
"""In a worker: set once its parent stops. A job more than there are workers is handed out by then, and must not begin."""


def import_beside(*modules: str) -> None:
    """Begin to import modules in a process beside this one; workers are forked from it and have them from the start.

    Only the first call before there are any workers has an effect.
    """
    _CONTEXT.set_forkserver_preload([*modules])
    with _held_interrupts():
        forkserver.ensure_running()


@contextmanager
def worker_pool(workers: int, jobs: int) -> Iterator[ProcessPoolExecutor]:
    """Fresh processes, no more than jobs, that save and stop when their parent is gone: the next call finds their runs free.

    Raises:
        SettingError: there is no worker.
        InterruptedRunError: Ctrl-C; the workers, and a run in this process, have saved and stopped.
    """
    check_value("workers", workers, Annotated[int, AT_LEAST_ONE])
    workers = min(workers, max(1, jobs))
    stopping = _CONTEXT.Event()
    with _Pool(workers, _CONTEXT, initializer=_stop_with_parent, initargs=(stopping,)) as pool:
        try:
            with _held_interrupts():
                for _ in range(workers):
                    pool.submit(int)  # starts a process
            yield pool
        except (KeyboardInterrupt, InterruptedRunError):  # the latter if a run in this process saved itself
            stopping.set()
            pool.shutdown(wait=False, cancel_futures=True)  # a worker ends with its run
            _stop(multiprocessing.active_children())
            raise InterruptedRunError("stopped; what was learnt is saved", remedy="the same command goes on") from None


class _Pool(ProcessPoolExecutor):
    def submit(self, fn: Callable[P, R], /, *args: P.args, **kwargs: P.kwargs) -> Future[R]:
        return super().submit(_unless_stopping, fn, *args, **kwargs)


def _unless_stopping(job: Callable[P, R], /, *args: P.args, **kwargs: P.kwargs) -> R:
    if _stopping.is_set():
        raise InterruptedRunError("stopped before it began")
    return job(*args, **kwargs)


@contextmanager
def _held_interrupts() -> Iterator[None]:
    """A Ctrl-C is heeded afterwards, and never by processes that are started meanwhile, which inherit the mask."""
    if threading.current_thread() is not threading.main_thread():
        yield
        return
    resource_tracker.ensure_running()  # its start would end the mask
    held = []
    previous = signal.signal(signal.SIGINT, lambda number, _: held.append(number))  # another thread may not be masked
    signal.pthread_sigmask(signal.SIG_BLOCK, {signal.SIGINT})
    try:
        yield
    finally:
        signal.pthread_sigmask(signal.SIG_UNBLOCK, {signal.SIGINT})
        signal.signal(signal.SIGINT, previous)
        for number in held:
            signal.raise_signal(number)


def _stop(children: Sequence[BaseProcess]) -> None:
    for child in children:
        child.terminate()
    deadline = time.monotonic() + GRACE
    for child in children:
        child.join(max(0.0, deadline - time.monotonic()))
        child.kill()


def _stop_with_parent(stopping: Event) -> None:
    global _stopping  # noqa: PLW0603 - an event reaches a worker as it starts, and no job can bring it
    _stopping = stopping
    os.setsid()  # a Ctrl-C is for the parent
    signal.pthread_sigmask(signal.SIG_UNBLOCK, {signal.SIGINT})
    parent = multiprocessing.parent_process()
    assert parent is not None

    def watch() -> None:
        parent.join()
        stopping.set()
        os.kill(os.getpid(), signal.SIGTERM)
        time.sleep(GRACE)
        os.kill(os.getpid(), signal.SIGKILL)

    threading.Thread(target=watch, daemon=True).start()
