"""Making a whole file of one that was cut."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from typing import Any

from mcap.records import Attachment, Channel, Message, Metadata, Schema
from mcap.writer import CompressionType, Writer

from transferkit.errors import RecordingError
from transferkit.files import check_new, new_file
from transferkit.record.mcap_file import Damage, records


def recover(path: Path, out: Path) -> tuple[int, bool]:
    """Copy every whole chunk of an MCAP file of any tool into a new file; returns its messages, and whether any was lost.

    Raises:
        RecordingError: not an MCAP file, or nothing whole in it.
        ConfigError: `out` exists, its name does not end in .mcap, or it cannot be written.
    """
    check_new(out, "out", ".mcap")
    count, whole = 0, True
    with new_file(out, "out") as temporary, temporary.open("wb") as file:
        writer = Writer(file, compression=CompressionType.ZSTD)
        writer.start(library="transferkit")
        copy = _Copy(writer)
        for record in records(path):
            whole = whole and not isinstance(record, Damage)
            count += copy(record)
        if not count:
            raise RecordingError(f"{path} has no whole chunk, so nothing can be recovered")
        writer.finish()
    return count, not whole


class _Copy:
    """Writes records under the numbers of the new file; returns 1 for a message."""

    def __init__(self, writer: Writer) -> None:
        self._writer = writer
        self._schemas: dict[int, int] = {0: 0}
        self._channels: dict[int, int] = {}
        self._actions: dict[type, Callable[[Any], None]] = {
            Schema: self._schema,
            Channel: self._channel,
            Message: self._message,
            Metadata: lambda record: writer.add_metadata(record.name, record.metadata),
            Attachment: lambda record: writer.add_attachment(
                record.create_time, record.log_time, record.name, record.media_type, record.data
            ),
        }

    def __call__(self, record: object) -> int:
        action = self._actions.get(type(record))
        if action is not None:
            action(record)
        return isinstance(record, Message)

    def _schema(self, record: Schema) -> None:
        if record.id not in self._schemas:
            self._schemas[record.id] = self._writer.register_schema(record.name, record.encoding, record.data)

    def _channel(self, record: Channel) -> None:
        if record.id not in self._channels:
            schema = self._schemas.get(record.schema_id, 0)
            self._channels[record.id] = self._writer.register_channel(
                record.topic, record.message_encoding, schema, record.metadata
            )

    def _message(self, record: Message) -> None:
        channel = self._channels.get(record.channel_id)  # None if what described it is damaged
        if channel is not None:
            self._writer.add_message(channel, record.log_time, record.data, record.publish_time, record.sequence)
