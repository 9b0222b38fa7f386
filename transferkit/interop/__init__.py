"""Policies of other libraries: read without running anything of their files, and made into cores that act the same."""

from transferkit.interop.foreign import Given, Scale
from transferkit.interop.read import read_core

__all__ = ["Given", "Scale", "read_core"]
