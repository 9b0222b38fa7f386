"""A Ray cluster as a pool of workers: `pip install transferkit[cluster]`."""

from __future__ import annotations

import os
import socket
from collections.abc import Callable, Iterator
from concurrent.futures import Future
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any

from experiments.matrix.cell_folder import finished, folder, pack, unpack
from experiments.matrix.grid import Cell
from transferkit.errors import ConfigError

if TYPE_CHECKING:
    from experiments.matrix.runner import Outcome

RETRIES = 20
"""Times a run is given to another worker when its own is lost with its machine."""

Job = Callable[[Cell], "Outcome"]


@dataclass(frozen=True)
class RayPool:
    """What `run_all` needs of an executor."""

    remote: Any
    """The remote function `(job, cell) -> (outcome, files)`."""
    out: Path

    def submit(self, job: Job, cell: Cell) -> Future[Outcome]:
        """Run a cell somewhere; its small files are here when the future is done, shared file system or not."""
        answer: Future[Outcome] = Future()
        self.remote.remote(job, cell).future().add_done_callback(lambda sent: self._receive(sent, cell, answer))
        return answer

    def _receive(self, sent: Future[tuple[Outcome, dict[str, bytes]]], cell: Cell, answer: Future[Outcome]) -> None:
        try:
            outcome, files = sent.result()
            if not finished(self.out, cell).exists():
                unpack(folder(self.out, cell), files)
        except BaseException as error:  # the one who waits gets it, not this thread
            answer.set_exception(error)
        else:
            answer.set_result(outcome)


def connect(address: str) -> int:
    """Connect with a cluster, on which transferkit is installed; returns how many cores it has.

    Raises:
        ConfigError: Ray is not installed, no address, or no cluster answers.
    """
    _check_address(address)
    os.environ.setdefault("RAY_USAGE_STATS_ENABLED", "0")
    try:
        import ray  # type: ignore[import-not-found] # noqa: PLC0415 - an extra, and seconds to import
    except ImportError:
        raise ConfigError("--ray needs Ray, which is not installed; pip install 'transferkit[cluster]'") from None
    environment = {"py_modules": [str(Path(__file__).parent)], "env_vars": {"OMP_NUM_THREADS": "1"}}
    try:
        ray.init(address=address, runtime_env=environment, log_to_driver=False, logging_level="ERROR")
    except (ConnectionError, RuntimeError, ValueError) as error:
        raise _no_cluster(address, error) from None
    cores = int(ray.cluster_resources().get("CPU", 0))
    if not cores:
        raise ConfigError(f"the Ray cluster at {address} has no cores; add a machine with `ray start --address`")
    return cores


@contextmanager
def ray_pool(out: Path) -> Iterator[RayPool]:
    """One run a core on every machine of the cluster that is connected; a lost machine's runs move on."""
    import ray  # type: ignore[import-not-found] # noqa: PLC0415

    try:
        yield RayPool(ray.remote(num_cpus=1, max_retries=RETRIES)(_work), out)
    finally:
        ray.shutdown()


def _check_address(address: str) -> None:
    """Find out at once whether anything listens; Ray itself would try for minutes.

    Raises:
        ConfigError: nothing does, or it is no address.
    """
    if address == "auto":
        return
    host, _, port = address.removeprefix("ray://").rpartition(":")
    if not host or not port.isdecimal():
        raise ConfigError(f"--ray {address} is no address; pass auto, HOST:PORT or ray://HOST:PORT")
    try:
        socket.create_connection((host, int(port)), timeout=10).close()
    except (OSError, OverflowError) as error:
        raise _no_cluster(address, error) from None


def _no_cluster(address: str, error: Exception) -> ConfigError:
    return ConfigError(f"no Ray cluster at {address} ({str(error).splitlines()[0]}); start one with `ray start --head`")


def _work(job: Job, cell: Cell) -> tuple[Outcome, dict[str, bytes]]:
    outcome = job(cell)
    return outcome, pack(folder(job.keywords["out"], cell))  # type: ignore[attr-defined] - a partial of run_cell
