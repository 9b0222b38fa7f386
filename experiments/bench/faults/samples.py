"""A whole sample of every format, made by the program itself, with its readers."""

from __future__ import annotations

import sys
from pathlib import Path
from typing import TYPE_CHECKING

from experiments.bench.faults.cores import cores
from experiments.bench.faults.foreign import foreign
from experiments.bench.faults.mutate import PLANTED
from experiments.bench.faults.recordings import recordings
from experiments.bench.faults.runs import cells, runs
from experiments.bench.faults.texts import texts

if TYPE_CHECKING:
    from experiments.bench.faults.formats import Format


def formats(scratch: Path) -> list[Format]:
    """All of them, in folders under `scratch`, which has the planted module too."""
    sys.path.insert(0, str(scratch))
    scratch.mkdir(parents=True)
    (scratch / f"{PLANTED}.py").write_text("")
    return [
        *cores(scratch / "core" / "small-v1"),
        *runs(scratch),
        cells(scratch / "cells"),
        *recordings(scratch),
        *texts(scratch),
        *foreign(scratch / "foreign"),
    ]
