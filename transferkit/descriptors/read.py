"""Recognise a descriptor and read it; nothing in it is run."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Any

from transferkit.descriptors.isaac import IODescriptors, read_isaac
from transferkit.descriptors.leapp import Leapp, read_leapp
from transferkit.files import others_file
from transferkit.reading import FormatError, parse_yaml, read_bytes, typed

if TYPE_CHECKING:
    from transferkit.descriptors.form import Descriptor

LARGEST = 4 * 2**20
"""Bytes."""


def read_descriptor(path: Path) -> Descriptor:
    """Read LEAPP YAML or Isaac Lab's IO descriptors.

    Raises:
        ArtifactError: it is missing, damaged or neither.
    """
    with others_file(path):
        data = parse_yaml(read_bytes(path, LARGEST), dict[str, Any])
        if "models" in data:
            return read_leapp(typed(data, Leapp))
        if "actions" in data and "observations" in data:
            return read_isaac(typed(data, IODescriptors))
        raise FormatError("it has neither models, as LEAPP YAML has, nor actions and observations, as Isaac Lab's has")
