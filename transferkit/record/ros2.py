"""Decoders of ROS 2 messages (CDR) from the definitions in a file, by mcap-ros2-support.

A definition from a stranger is reduced to its fields before the library parses it: what the library does with constants,
defaults and comments can take for ever, and none of them is in a message. Lengths in a message are held against its bytes.
"""

from __future__ import annotations

import contextlib
import importlib
import io
import re
from collections.abc import Callable, Iterator
from typing import Any

from mcap.records import Schema

LARGEST_DEFINITION, LARGEST_MESSAGE = 2**18, 2**16
"""Bytes: the definitions of the largest ROS packages have a third; 4,096 numbers, the most of an observation, a half."""

MOST_FIELDS, DEEPEST = 2**12, 10
"""Fields of all types of a definition, and types within types; a trajectory of transforms has 5."""

PLAIN = ("bool", "byte", "char", "string", "wstring", "time", "duration")
NUMBERS = tuple(f"{kind}{bits}" for kind in ("int", "uint", "float") for bits in (8, 16, 32, 64))

_BORDER = re.compile(r"={3,}")
_NAME = re.compile(r"MSG:\s*([\w/]+)", re.ASCII)
_FIELD = re.compile(r"([\w/]+)((?:<=\d{1,9})?(?:\[(?:<=)?\d{0,9}\])?)\s+(\w+)\s*(=?)", re.ASCII)


def ros2_decoder(schema: Schema | None) -> Callable[[bytes], Any]:
    """Make the decoder of a type's messages.

    Raises:
        ModuleNotFoundError: mcap-ros2-support is not installed.
        ValueError: no definition in ROS 2's message format, or one that is too large; the library raises more kinds.
    """
    if schema is None or schema.encoding != "ros2msg":
        raise ValueError(f"its schema has the encoding {schema.encoding if schema else None}, ros2msg is read")
    library = importlib.import_module("mcap_ros2.decoder")
    plain = Schema(schema.id, plain_definition(schema).encode(), schema.encoding, schema.name)
    with contextlib.redirect_stderr(io.StringIO()):  # the library prints what it raises, too
        decode = library.DecoderFactory().decoder_for("cdr", plain)
    return lambda data: decode(_checked(data))


def plain_definition(schema: Schema) -> str:
    """Write a definition again without constants, defaults and comments.

    Raises:
        ValueError: it is none, too large, or its types nest too deep or without end.
    """
    if len(schema.data) > LARGEST_DEFINITION:
        raise ValueError(f"its definition has {len(schema.data)} bytes, at most {LARGEST_DEFINITION} are read")
    lines, nested, fields = [], {}, 0
    name = root = _short(schema.name)
    for line in schema.data.decode().splitlines():
        content = line.split("#", 1)[0].strip()
        if _BORDER.fullmatch(content) or not content:
            continue
        if head := _NAME.fullmatch(content):
            name = _short(head[1])
            lines += ["===", f"MSG: {name}"]
            continue
        for type_name, size, field in _fields(content):
            fields += 1
            nested.setdefault(name, set()).update(_within(type_name, name))
            lines.append(f"{type_name}{size} {field}")
    if fields > MOST_FIELDS:
        raise ValueError(f"its definition has {fields} fields, at most {MOST_FIELDS} are read")
    _check_depth(root, nested)
    return "\n".join(lines)


def _fields(line: str) -> Iterator[tuple[str, str, str]]:
    found = _FIELD.match(line)
    if not found:
        raise ValueError(f"its definition has the line {line[:40]!r}")
    if not found[4]:  # else it is a constant
        yield _short(found[1]), found[2], found[3]


def _within(type_name: str, name: str) -> set[str]:
    if type_name in PLAIN + NUMBERS:
        return set()
    return {type_name if "/" in type_name else f"{name.partition('/')[0]}/{type_name}"}


def _check_depth(root: str, nested: dict[str, set[str]]) -> None:
    level = {root}
    for _ in range(DEEPEST):
        level = set().union(*(nested.get(name, ()) for name in level))
    if level:
        raise ValueError(f"its types nest more than {DEEPEST} deep")


def _short(name: str) -> str:
    return name.replace("/msg/", "/")


def _checked(data: bytes) -> bytes:
    """Check what the library does not.

    Raises:
        ValueError: it is too large, or not plain CDR.
    """
    if len(data) > LARGEST_MESSAGE:
        raise ValueError(f"it has {len(data)} bytes, at most {LARGEST_MESSAGE} are read")
    if data[:2] not in (b"\0\0", b"\0\1"):
        raise ValueError(f"its encapsulation is {data[:2].hex() or 'none'}, 0000 and 0001 are read")
    return _Whole(data)


class _Whole(bytes):
    """Bytes that refuse a slice beyond their end, which the library would take for an empty array, as often as asked."""

    def __getitem__(self, key: Any) -> Any:  # noqa: ANN401 - as in bytes
        if isinstance(key, slice) and key.stop > len(self):
            raise ValueError("it is cut")
        return super().__getitem__(key)
