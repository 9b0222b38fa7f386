"""Tables of a run by column."""

from __future__ import annotations

import functools
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from transferkit.run import read_table

if TYPE_CHECKING:
    from transferkit.run import Row


def columns(run: Path, kind: type[Row]) -> dict[str, NDArray[np.float64]]:
    """A table of a run by column, `(rows,)` each; read once as long as the file stays the same."""
    stat = kind.file(run).stat()
    return _columns(run, kind, stat.st_mtime_ns, stat.st_size, stat.st_ino)


@functools.lru_cache(maxsize=10_000)
def _columns(run: Path, kind: type[Row], *_version: int) -> dict[str, NDArray[np.float64]]:
    return read_table(run, kind)
