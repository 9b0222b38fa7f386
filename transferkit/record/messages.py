"""Numbers from the messages of other tools: JSON, protobuf, and ROS 2's CDR."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from typing import Any

import orjson
from mcap.records import Channel, Schema
from mcap_protobuf.decoder import DecoderFactory

from transferkit.errors import RecordingError, reason_of
from transferkit.record.ros2 import ros2_decoder


class Decoder:
    """Decodes the messages of a file."""

    def __init__(self, path: Path) -> None:
        self._path = path
        self._protobuf = DecoderFactory()
        self._ros2: dict[int, Callable[[bytes], Any]] = {}
        self._ways = {"json": _from_json, "protobuf": self._from_protobuf, "cdr": self._from_cdr}

    def __call__(self, channel: Channel, schema: Schema | None, data: bytes) -> object:
        """Decode a message into dicts and lists, or an object with fields.

        Raises:
            RecordingError: an unknown encoding, a schema or a message that is damaged, or a package is missing.
        """
        way = self._ways.get(channel.message_encoding)
        if way is None:
            raise RecordingError(
                f"{self._path}: encoding of topic {channel.topic}",
                value=channel.message_encoding,
                allowed="json, protobuf or cdr",
            )
        try:
            return way(schema, data)
        except ModuleNotFoundError as error:
            raise RecordingError(
                f"{self._path} is a recording of ROS 2, and {error.name} is missing", remedy="pip install mcap-ros2-support"
            ) from None
        except Exception as error:  # whatever the libraries raise for a schema or a message that is none
            raise RecordingError(
                f"{self._path}: a message on {channel.topic} does not decode as {channel.message_encoding} ({reason_of(error)})"
            ) from None

    def _from_protobuf(self, schema: Schema | None, data: bytes) -> object:
        decode = self._protobuf.decoder_for("protobuf", schema)
        if decode is None:
            raise ValueError("it has no schema of protobuf")
        return decode(data)

    def _from_cdr(self, schema: Schema | None, data: bytes) -> object:
        key = schema.id if schema else 0
        if key not in self._ros2:
            self._ros2[key] = ros2_decoder(schema)
        return self._ros2[key](data)


def number(message: object, field: str, topic: str) -> float:
    """Take a field, given by its path such as `position.0`, out of a message.

    Raises:
        RecordingError: there is none, or it is not a number.
    """
    node: Any = message
    for name in field.split("."):
        try:
            node = node[int(name)] if name.isdigit() else node[name] if isinstance(node, dict) else getattr(node, name)
        except (LookupError, TypeError, AttributeError, ValueError):
            raise RecordingError(f"topic {topic} has no field {field}", remedy="check the mapping") from None
    try:
        return float(node)
    except (TypeError, ValueError, OverflowError):
        raise RecordingError(f"field {field} of topic {topic} is not a number", remedy="check the mapping") from None


def _from_json(schema: Schema | None, data: bytes) -> object:
    del schema
    return orjson.loads(data)
