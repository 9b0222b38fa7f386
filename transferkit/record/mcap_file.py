"""The records of an MCAP file of any tool, as far as they are whole; nothing in a file is run."""

from __future__ import annotations

import os
import zlib
from collections.abc import Iterator
from io import BytesIO
from pathlib import Path
from typing import Any, BinaryIO, NamedTuple

import lz4.frame
import zstandard
from mcap.data_stream import ReadDataStream
from mcap.opcode import Opcode
from mcap.records import Attachment, Channel, Chunk, DataEnd, Message, Metadata, Schema
from mcap.stream_reader import breakup_chunk

from transferkit.errors import RecordingError

MAGIC = b"\x89MCAP0\r\n"

RATIO, ALLOWANCE = 200, 2**20
"""A chunk is no larger than so many times its compressed bytes, and so many more: real ones are 3 to 20 times as large."""

LARGEST = 2**28
"""Bytes of a record."""

READERS: dict[int, Any] = {
    Opcode.SCHEMA: Schema.read,
    Opcode.CHANNEL: Channel.read,
    Opcode.ATTACHMENT: Attachment.read,
    Opcode.METADATA: Metadata.read,
}


class Damage(NamedTuple):
    """A part of a file that is not whole."""

    cut: bool
    """Nothing behind it can be read."""


def records(path: Path) -> Iterator[Any]:
    """Yield every whole record in order, those in chunks too, and a `Damage` in place of what is not whole.

    Raises:
        RecordingError: it does not exist, or is not an MCAP file.
    """
    try:
        file = path.open("rb") if path.is_file() else None
    except OSError as error:
        raise RecordingError(f"cannot read {path}: {error.strerror}", topic="recordings") from None
    if file is None:
        what = "is not a file" if path.exists() else "No such file or directory"
        raise RecordingError(f"cannot read {path}: {what}", topic="recordings")
    with file:
        if file.read(len(MAGIC)) != MAGIC:
            raise RecordingError(f"{path} is not an MCAP file", topic="recordings")
        left, checksum = path.stat().st_size - len(MAGIC), zlib.crc32(MAGIC)
        while True:
            head = file.read(9)
            length = int.from_bytes(head[1:], "little")
            left -= 9 + length
            if len(head) < 9 or left < 0 or length > LARGEST or not head[0]:
                yield Damage(cut=True)
                return
            opcode, content = head[0], file.read(length)
            if opcode == Opcode.DATA_END:  # what follows repeats what was before it
                yield from _end(content, checksum, _tail(file))
                return
            checksum = zlib.crc32(content, zlib.crc32(head, checksum))
            yield from _whole(opcode, content)


def _tail(file: BinaryIO) -> bytes:
    file.seek(-len(MAGIC), os.SEEK_END)
    return file.read()


def _whole(opcode: int, content: bytes) -> list[Any]:
    try:
        stream = ReadDataStream(BytesIO(content))
        if opcode == Opcode.CHUNK:
            return _of_chunk(Chunk.read(stream))
        if opcode == Opcode.MESSAGE:
            return [Message.read(stream, len(content))]
        return [READERS[opcode](stream)] if opcode in READERS else []
    except Exception:  # whatever mcap and the decompressors raise for bytes that are not theirs
        return [Damage(cut=False)]


def _of_chunk(chunk: Chunk) -> list[Any]:
    size, most = chunk.uncompressed_size, RATIO * len(chunk.data) + ALLOWANCE
    if size > most:
        raise ValueError(f"it declares {size} bytes")
    if chunk.compression == "zstd":
        if zstandard.frame_content_size(chunk.data) not in (-1, size):
            raise ValueError("it declares two sizes")
        chunk.data = zstandard.decompress(chunk.data, size)
    elif chunk.compression == "lz4":
        chunk.data = lz4.frame.LZ4FrameDecompressor().decompress(chunk.data, max_length=size + 1)
    elif chunk.compression:
        raise ValueError(f"unknown compression {chunk.compression}")
    if len(chunk.data) != size:
        raise ValueError(f"it has {len(chunk.data)} bytes and declares {size}")
    chunk.compression = ""
    return breakup_chunk(chunk, validate_crc=True)


def _end(content: bytes, checksum: int, tail: bytes) -> Iterator[Damage]:
    end = DataEnd.read(ReadDataStream(BytesIO(content))) if len(content) == 4 else DataEnd(data_section_crc=0)
    if tail != MAGIC:
        yield Damage(cut=True)
    elif end.data_section_crc not in (0, checksum):
        yield Damage(cut=False)
