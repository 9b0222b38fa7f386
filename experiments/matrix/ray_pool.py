"""A Ray cluster as a pool of workers: `pip install transferkit[cluster]`."""

from __future__ import annotations

import os
import socket
from collections.abc import Callable, Iterator
from concurrent.futures import Future
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any, Generic, TypeVar

from experiments.matrix.cell_folder import SPEED, folder, pack, unpack
from transferkit.errors import ConfigError, reason_of
from transferkit.extras import import_extra

if TYPE_CHECKING:
    from experiments.matrix.cell import Cell

RETRIES = 20
"""Times a run is given to another worker when its own is lost with its machine."""

Answer = TypeVar("Answer")


@dataclass(frozen=True)
class RayPool(Generic[Answer]):
    """The part of an executor that a matrix needs."""

    remote: Any
    """The remote function `(job, cell, out) -> (answer, files)`."""
    out: Path

    def submit(self, job: Callable[[Cell], Answer], cell: Cell) -> Future[Answer]:
        """Run a cell somewhere; its small files are here when the future is done, shared file system or not."""
        answer: Future[Answer] = Future()
        sent = self.remote.remote(job, cell, self.out).future()
        sent.add_done_callback(lambda done: self._receive(done, cell, answer))
        return answer

    def _receive(self, sent: Future[tuple[Answer, dict[str, bytes]]], cell: Cell, answer: Future[Answer]) -> None:
        try:
            found, files = sent.result()
            if not (folder(self.out, cell) / SPEED).exists():
                unpack(folder(self.out, cell), files)
        except BaseException as error:  # the one who waits gets it, not this thread
            answer.set_exception(error)
        else:
            answer.set_result(found)


def connect(address: str) -> int:
    """Connect with a cluster on which transferkit is installed; returns how many cores it has.

    Raises:
        ConfigError: Ray cannot be imported, the address is wrong, or no cluster answers.
    """
    _check_address(address)
    os.environ.setdefault("RAY_USAGE_STATS_ENABLED", "0")
    ray = import_extra("ray", "cluster", "a Ray cluster")
    environment = {"py_modules": [str(Path(__file__).parents[1])], "env_vars": {"OMP_NUM_THREADS": "1"}}
    try:
        ray.init(address=address, runtime_env=environment, log_to_driver=False, logging_level="ERROR")
    except (ConnectionError, RuntimeError, ValueError) as error:
        raise _no_cluster(address, error) from None
    cores = int(ray.cluster_resources().get("CPU", 0))
    if not cores:
        raise ConfigError(f"the Ray cluster at {address} has no cores", remedy="add a machine with `ray start --address`")
    return cores


@contextmanager
def ray_pool(out: Path) -> Iterator[RayPool]:
    """One run a core on every machine of the cluster that is connected; a lost machine's runs move on."""
    ray = import_extra("ray", "cluster", "a Ray cluster")
    try:
        yield RayPool(ray.remote(num_cpus=1, max_retries=RETRIES)(_work), out)
    finally:
        ray.shutdown()


def _check_address(address: str) -> None:
    """Find out at once whether anything listens; Ray itself would try for minutes."""
    if address == "auto":
        return
    host, _, port = address.removeprefix("ray://").rpartition(":")
    if not host or not port.isdecimal():
        raise ConfigError("{ray}", value=address, allowed="auto, HOST:PORT or ray://HOST:PORT")
    try:
        socket.create_connection((host, int(port)), timeout=10).close()
    except (OSError, OverflowError) as error:
        raise _no_cluster(address, error) from None


def _no_cluster(address: str, error: Exception) -> ConfigError:
    return ConfigError(f"no Ray cluster at {address} ({reason_of(error)})", remedy="start one with `ray start --head`")


def _work(job: Callable[[Cell], Answer], cell: Cell, out: Path) -> tuple[Answer, dict[str, bytes]]:
    answer = job(cell)
    return answer, pack(folder(out, cell))
