"""The index of a zoo elsewhere: which cores it has, and the hash of each of their files."""

from __future__ import annotations

import hashlib
import json
from collections.abc import Mapping
from dataclasses import asdict, dataclass, field
from typing import Annotated, Any

import msgspec

from transferkit.reading import FormatError, parse, sealed, typed, unsealed
from transferkit.zoo.card import CARD, LARGEST, PROBE, WEIGHTS, CoreId, Sha256
from transferkit.zoo.summary import Summary

INDEX = "index.json"

LARGEST_INDEX = 16 * 2**20
"""Bytes."""

SCHEMA = 1
"""Version of the index that this transferkit writes, and the newest it reads."""

FILES = (WEIGHTS, PROBE, CARD)
"""What is fetched of a core; its README is made of the card."""


@dataclass(frozen=True)
class File:
    """A file of a core."""

    sha256: Sha256
    size: Annotated[int, msgspec.Meta(ge=0, le=LARGEST)]
    """Bytes."""

    @staticmethod
    def of(data: bytes) -> File:
        """Describe these bytes."""
        return File(hashlib.sha256(data).hexdigest(), len(data))


@dataclass(frozen=True)
class Entry:
    """A core."""

    files: Mapping[str, File]
    """By name."""
    summary: Summary

    def __post_init__(self) -> None:
        if set(self.files) != set(FILES):
            raise ValueError(f"a core has the files {', '.join(sorted(self.files))}, not {', '.join(sorted(FILES))}")

    @property
    def digest(self) -> str:
        """sha256 of its card, which holds those of the other files."""
        return self.files[CARD].sha256


@dataclass(frozen=True)
class Index:
    """All cores of a zoo, by id."""

    cores: Mapping[CoreId, Entry] = field(default_factory=dict)
    schema: Annotated[int, msgspec.Meta(ge=1)] = SCHEMA

    def to_bytes(self) -> bytes:
        """Write it as JSON that is sealed with a digest of its content."""
        return (json.dumps(sealed(asdict(self)), indent=1, sort_keys=True, allow_nan=False) + "\n").encode()

    @staticmethod
    def from_bytes(data: bytes) -> Index:
        """Read what `to_bytes` wrote.

        Raises:
            FormatError: it is no index, was changed, or is too new.
        """
        content = unsealed(parse(data, dict[str, Any]), required=True)
        if isinstance(schema := content.get("schema"), int) and schema > SCHEMA:
            raise FormatError(f"its schema is {schema}, this transferkit reads up to {SCHEMA}")
        return typed(content, Index)


def digest_of(data: bytes) -> str:
    """The digest by which the bytes of an index are signed off."""
    return hashlib.sha256(data).hexdigest()
