"""What other stacks write beside a policy about its numbers: read, and compared with the physics of an environment."""

from transferkit.descriptors.compare import Row, compare
from transferkit.descriptors.form import Channel, Descriptor
from transferkit.descriptors.read import read_descriptor
from transferkit.descriptors.remap import Remap, remap

__all__ = ["Channel", "Descriptor", "Remap", "Row", "compare", "read_descriptor", "remap"]
