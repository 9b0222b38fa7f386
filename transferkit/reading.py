"""Reading what others wrote: regular files of a bounded size, and JSON in which every value has its declared type.

A reader of a format describes it as dataclasses; `parse` and `typed` (msgspec) compare every value with its annotation. NaN,
infinity and lone surrogates are no JSON; nothing in a file is run.
"""

from __future__ import annotations

import dataclasses
import functools
import hashlib
import json
import os
import re
import stat
import tomllib
from collections.abc import Iterable, Iterator, Mapping, Sequence
from pathlib import Path
from typing import Annotated, Any, ClassVar, TypeVar

import msgspec

T = TypeVar("T")

DEEPEST = 50
"""Levels of lists and objects in each other."""

MOST_REPEATED = 100_000
"""Values that references in a YAML file may stand for."""

Count = Annotated[int, msgspec.Meta(ge=0, le=2**53)]
"""A whole number that is not negative."""
Size = Annotated[int, msgspec.Meta(ge=1, le=65_536)]
"""A dimension of an array."""
Layers = Annotated[tuple[Size, ...], msgspec.Meta(min_length=1, max_length=64)]
"""Widths of layers."""


class FormatError(ValueError):
    """What is wrong with the content of a file, in one line without the file's name."""


def read_bytes(path: Path, most: int, *, follow: bool = True) -> bytes:
    """Read a regular file of at most so many bytes, where `follow` allows a link to it.

    Raises:
        FormatError: it is a device, a pipe or a folder, or is larger.
        OSError: it cannot be opened.
    """
    if "\0" in str(path):
        raise FormatError("no file's name has a null character")
    flags = os.O_RDONLY | os.O_NONBLOCK | os.O_CLOEXEC | (0 if follow else os.O_NOFOLLOW)
    with open(path, "rb", opener=lambda name, _: os.open(name, flags)) as file:
        status = os.fstat(file.fileno())
        if not stat.S_ISREG(status.st_mode):
            raise FormatError("it is not a regular file")
        if status.st_size > most:
            raise FormatError(f"it has {status.st_size:,} bytes, at most {most:,} are read")
        return file.read(status.st_size)


def parse(data: bytes | str, kind: type[T]) -> T:
    """Read JSON as a value of this type.

    Raises:
        FormatError: it is not JSON, or a value in it has another type.
    """
    try:
        value = msgspec.json.decode(data)
    except (msgspec.MsgspecError, ValueError) as error:
        raise FormatError(f"not JSON: {error}") from None
    except RecursionError:
        raise FormatError("its values are nested too deeply") from None
    if _deeper(value, DEEPEST):
        raise FormatError("its values are nested too deeply")
    return typed(value, kind)


def parse_toml(data: bytes, kind: type[T]) -> T:
    """Read TOML as a value of this type, which has a field for every key.

    Raises:
        FormatError: it is not TOML, a key is unknown, or a value has another type.
    """
    try:
        value = tomllib.loads(data.decode("utf-8-sig"))
    except (ValueError, RecursionError) as error:
        raise FormatError(f"not TOML: {str(error) or 'nested too deeply'}") from None
    if _deeper(value, DEEPEST):
        raise FormatError("its values are nested too deeply")
    return _strict(value, kind)


def parse_yaml(data: bytes, kind: type[T]) -> T:
    """Read YAML, or JSON, as a value of this type, which has a field for every key.

    Raises:
        FormatError: it is neither, a key is unknown, or a value has another type.
    """
    import yaml  # noqa: PLC0415 - most formats are none

    try:
        text = data.decode("utf-8-sig")
        _check_structure(yaml.parse(text, yaml.SafeLoader))
        loader = _yaml_loader()(text)
        node = loader.get_single_node()
        _check_keys(node)
        value = None if node is None else loader.construct_document(node)
    except FormatError:
        raise
    except (yaml.YAMLError, ValueError, LookupError, AttributeError, TypeError, RecursionError) as error:
        raise FormatError(f"not YAML: {' '.join(str(error).split()) or 'nested too deeply'}") from None
    if _deeper(value, DEEPEST):
        raise FormatError("its values are nested too deeply")
    return _strict(value, kind)


PLAIN = {
    "bool": (r"true|True|TRUE|false|False|FALSE", "tTfF"),
    "null": (r"~|null|Null|NULL|", ["~", "n", "N", ""]),
    "int": (r"[-+]?[0-9]+", "-+0123456789"),
    "float": (r"[-+]?(\.[0-9]+|[0-9]+(\.[0-9]*)?)([eE][-+]?[0-9]+)?|[-+]?\.(inf|Inf|INF)|\.(nan|NaN|NAN)", "-+.0123456789"),
    "merge": (r"<<", "<"),
}
"""What plain words of YAML are, by its version 1.2 (10.3.2): in 1.1, PyYAML's, 010 is eight, 1:30 ninety and 1e5 a text."""


@functools.cache
def _yaml_loader() -> type[Any]:
    import yaml  # noqa: PLC0415

    class Loader(yaml.SafeLoader):
        yaml_implicit_resolvers: ClassVar[dict[str, Any]] = {}  # pyright: ignore[reportIncompatibleVariableOverride]

        def construct_yaml_int(self, node: Any) -> int:  # noqa: ANN401
            return int(self.construct_scalar(node))

    for kind, (pattern, first) in PLAIN.items():
        Loader.add_implicit_resolver(f"tag:yaml.org,2002:{kind}", re.compile(f"(?:{pattern})$"), list(first))
    Loader.add_constructor("tag:yaml.org,2002:int", Loader.construct_yaml_int)
    return Loader


def _check_structure(events: Iterable[Any]) -> None:
    """Refuse references within what is referred to, or to more values than a file of this kind has; and what is nested deeply.

    That is told while it is read: PyYAML takes minutes over 100,000 brackets.
    """
    opened: list[str | None] = []
    sizes: dict[str, int] = {}
    total = 0
    for event in events:
        kind = type(event).__name__
        if kind == "AliasEvent":
            total += sizes.get(event.anchor, 0)
            if any(opened) or total > MOST_REPEATED:
                raise FormatError("its references stand for more than is read")
        elif kind in ("SequenceEndEvent", "MappingEndEvent"):
            opened.pop()
        elif kind in ("SequenceStartEvent", "MappingStartEvent", "ScalarEvent"):
            for name in filter(None, [*opened, event.anchor]):
                sizes[name] = sizes.get(name, 0) + 1
            if kind != "ScalarEvent":
                opened.append(event.anchor)
                if len(opened) > DEEPEST:
                    raise FormatError("its values are nested too deeply")


def _check_keys(node: Any) -> None:  # noqa: ANN401 - a node of YAML, or None of an empty file
    """Refuse a name that stands twice in one mapping."""
    kind, names = type(node).__name__, set[str]()
    if kind == "SequenceNode":
        for inner in node.value:
            _check_keys(inner)
    elif kind == "MappingNode":
        for key, inner in node.value:
            _check_keys(inner)
            if not isinstance(key.value, str):  # no name, which is refused later
                continue
            if key.value in names:
                raise FormatError(f"{key.value} stands twice in one place, again in line {key.start_mark.line + 1}")
            names.add(key.value)


def typed(value: object, kind: type[T]) -> T:
    """Take JSON-ready data as a value of this type.

    Raises:
        FormatError: something in it has another type, or is missing.
    """
    try:
        return msgspec.convert(value, kind)
    except (msgspec.MsgspecError, ValueError, OverflowError) as error:
        raise FormatError(f"{error}{_allowed(str(error), kind)}") from None


def _allowed(error: str, kind: type) -> str:
    """What may stand where msgspec found none of the values that a type lists."""
    if not error.startswith("Invalid enum value") or " at `key` in " in error:
        return ""
    steps = [name or place for name, place in re.findall(r"\.(\w+)|\[([\d.]+)\]", error.rpartition("`$")[2])]
    return f"; known are {', '.join(dict.fromkeys(map(str, _listed(msgspec.inspect.type_info(kind), steps))))}"


def _listed(info: Any, steps: Sequence[str]) -> Iterator[object]:  # noqa: ANN401 - one of msgspec's forty classes
    """The values that a type lists at the end of the steps."""
    match info:
        case msgspec.inspect.UnionType():
            inner = [(one, steps) for one in info.types]
        case msgspec.inspect.DataclassType():
            inner = [(field.type, steps[1:]) for field in info.fields if field.encode_name in steps[:1]]
        case msgspec.inspect.DictType():
            inner = [(info.value_type, steps[1:])]
        case msgspec.inspect.ListType() | msgspec.inspect.VarTupleType():
            inner = [(info.item_type, steps[1:])]
        case msgspec.inspect.TupleType():
            inner = [(one, steps[1:]) for k, one in enumerate(info.item_types) if [str(k)] == steps[:1]]
        case msgspec.inspect.LiteralType():
            yield from info.values
            return
        case _:
            return
    for one, rest in inner:
        yield from _listed(one, rest)


def _strict(value: object, kind: type[T]) -> T:
    """Take data as a value of this type, which has a field for every key."""
    if dataclasses.is_dataclass(kind) and isinstance(value, dict):  # a slip in a name is said before what it leaves missing
        _refuse_unknown(value, kind)
    result = typed(value, kind)
    _refuse_strangers(value, result)
    return result


def _refuse_unknown(value: dict[Any, Any], kind: Any) -> None:  # noqa: ANN401 - a dataclass, or one of its values
    known = [field.name for field in dataclasses.fields(kind)]
    if strangers := sorted(map(str, value.keys() - set(known))):
        raise FormatError(f"unknown {strangers[0]}; known are {', '.join(known)}")


def _refuse_strangers(value: object, result: object) -> None:
    """Refuse keys that no field of a dataclass has taken, at any depth."""
    if isinstance(value, dict) and dataclasses.is_dataclass(result):
        _refuse_unknown(value, result)
        for name, inner in value.items():
            _refuse_strangers(inner, getattr(result, name))
    elif isinstance(value, list) and isinstance(result, tuple | list):
        for inner, own in zip(value, result, strict=False):
            _refuse_strangers(inner, own)


def digest(data: Mapping[str, Any]) -> str:
    """Compute the sha256 of the canonical JSON of these values."""
    return hashlib.sha256(json.dumps(data, sort_keys=True, allow_nan=False).encode()).hexdigest()


def sealed(data: Mapping[str, Any]) -> dict[str, Any]:
    """Add a `digest` of all other values, in place of an earlier one."""
    content = {name: value for name, value in data.items() if name != "digest"}
    return {**content, "digest": digest(json.loads(json.dumps(content, allow_nan=False)))}


def unsealed(data: Mapping[str, Any], *, required: bool = False) -> dict[str, Any]:
    """Check the `digest` and leave it out; what earlier versions wrote has none, unless it is `required`.

    Raises:
        FormatError: the data is not what it was when it was sealed.
    """
    content = {name: value for name, value in data.items() if name != "digest"}
    if (required or "digest" in data) and data.get("digest") != digest(content):
        raise FormatError("it was changed: its digest does not fit")
    return content


def _deeper(value: object, most: int) -> bool:
    level = [value]
    for _ in range(most):
        inner = [node.values() if isinstance(node, dict) else node for node in level if isinstance(node, dict | list)]
        level = [child for children in inner for child in children]
    return bool(level)
