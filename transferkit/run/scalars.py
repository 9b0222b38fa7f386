"""Scalars of a run for TensorBoard."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path

from transferkit.files import writing


class ScalarLog:
    """Event files in the folder `tensorboard` of a run."""

    def __init__(self, run: Path, purge_step: int) -> None:
        """Open the files; what a killed process wrote from `purge_step` on is replaced."""
        from torch.utils.tensorboard import SummaryWriter  # noqa: PLC0415 - half a second, and only training needs it

        self._folder = run / "tensorboard"
        with writing(self._folder):
            self._writer = SummaryWriter(str(self._folder), purge_step=purge_step)

    def add(self, scalars: Mapping[str, float], step: int) -> None:
        """Write scalars at an environment step."""
        with writing(self._folder):
            for name, value in scalars.items():
                self._writer.add_scalar(name, value, step)

    def close(self) -> None:
        """Flush and close the files."""
        with writing(self._folder):
            self._writer.close()
