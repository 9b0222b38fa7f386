"""The run directory: what a training run writes, so that a kill at any moment leaves it readable and resumable."""

from transferkit.run.directory import RunDirectory
from transferkit.run.streams import Streams

__all__ = ["RunDirectory", "Streams"]
