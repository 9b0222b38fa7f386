"""Ctrl-C and SIGTERM as a request to stop at the next good moment."""

from __future__ import annotations

import signal
import threading
from collections.abc import Iterator
from contextlib import contextmanager


class StopRequest:
    """Whether somebody asked to stop."""

    def __init__(self) -> None:
        self.made = False

    def heed(self, number: int, frame: object) -> None:
        """Note the first signal; raise at a second one, to stop at once."""
        if self.made:
            raise KeyboardInterrupt
        self.made = True


@contextmanager
def stop_signals() -> Iterator[StopRequest]:
    """Collect signals while the context lasts; in a thread, which gets none, nothing changes."""
    request = StopRequest()
    if threading.current_thread() is not threading.main_thread():
        yield request
        return
    previous = {number: signal.signal(number, request.heed) for number in (signal.SIGINT, signal.SIGTERM)}
    try:
        yield request
    finally:
        for number, handler in previous.items():
            signal.signal(number, handler)
