"""Tables of a run by column."""

from __future__ import annotations

import csv
import functools
from pathlib import Path

import numpy as np
from numpy.typing import NDArray


def columns(run: Path, name: str) -> dict[str, NDArray[np.float64]]:
    """A table of a run by column, `(rows,)` each; read once as long as the file stays the same."""
    path = run / f"{name}.csv"
    stat = path.stat()
    return _columns(path, stat.st_mtime_ns, stat.st_size, stat.st_ino)


@functools.lru_cache(maxsize=10_000)
def _columns(path: Path, *_version: int) -> dict[str, NDArray[np.float64]]:
    with path.open(newline="") as file:
        header, *rows = csv.reader(file)
    return dict(zip(header, np.array(rows, float).reshape(-1, len(header)).T, strict=True))
