"""Scalars of a run for TensorBoard."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path


class ScalarLog:
    """Event files in the folder `tensorboard` of a run."""

    def __init__(self, run: Path, purge_step: int) -> None:
        """Open the files; what a killed process wrote from `purge_step` on is replaced."""
        from torch.utils.tensorboard import SummaryWriter  # noqa: PLC0415 - half a second, and only training needs it

        self._writer = SummaryWriter(str(run / "tensorboard"), purge_step=purge_step)

    def add(self, scalars: Mapping[str, float], step: int) -> None:
        """Write scalars at an environment step."""
        for name, value in scalars.items():
            self._writer.add_scalar(name, value, step)

    def close(self) -> None:
        """Flush and close the files."""
        self._writer.close()
