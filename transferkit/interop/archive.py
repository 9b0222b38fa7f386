"""Zip files of strangers: nothing is unpacked that is much larger than its file."""

from __future__ import annotations

import io
import zipfile
import zlib

from transferkit.reading import FormatError

MOST_MEMBERS = 10_000

LARGEST_RATIO = 20
"""Bytes that a byte of the file may unpack to; weights hardly compress."""

BROKEN = (zipfile.BadZipFile, zlib.error, NotImplementedError, RuntimeError, OSError, EOFError, ValueError, LookupError)
"""What Python raises over a damaged, encrypted or strangely compressed file."""


class Archive:
    """The members of a zip by name."""

    def __init__(self, data: bytes) -> None:
        """Read the directory, and check the sizes that it declares.

        Raises:
            FormatError: it is damaged, or unpacks to much more than it has.
        """
        try:
            self._zip = zipfile.ZipFile(io.BytesIO(data))
        except BROKEN as error:
            raise FormatError(f"not a whole zip file: {error}") from None
        members = self._zip.infolist()
        self.names = [member.filename for member in members]
        if len(members) > MOST_MEMBERS or len({*self.names}) < len(members):
            raise FormatError(f"its zip has {len(members)} members, some more than once or more than {MOST_MEMBERS:,}")
        total = sum(member.file_size for member in members)
        if total > LARGEST_RATIO * len(data):
            raise FormatError(f"its zip unpacks to {total:,} bytes, more than {LARGEST_RATIO} times its size")

    def read(self, name: str) -> bytes:
        """Read a member, whose checksum fits.

        Raises:
            FormatError: it is missing or damaged.
        """
        try:
            with self._zip.open(name) as member:
                size = self._zip.getinfo(name).file_size
                data = member.read(size + 1)
        except BROKEN as error:
            raise FormatError(f"its member {name} is missing or damaged: {error}") from None
        if len(data) != size:
            raise FormatError(f"its member {name} has another size than its zip says")
        return data
