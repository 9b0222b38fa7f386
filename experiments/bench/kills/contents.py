"""What a job's folder holds: whole files, known names, and contents without times that can be compared."""

from __future__ import annotations

import csv
import hashlib
import json
import re
from collections.abc import Callable, Mapping
from pathlib import Path
from typing import Any

import torch

from transferkit.record.reader import Contents, read
from transferkit.run import load_state
from transferkit.run.directory import CHECKPOINT
from transferkit.zoo.artifact import load_core
from transferkit.zoo.card import CARD
from transferkit.zoo.release import UNFINISHED

TIMES = {"seconds", "digest", "files"}
"""Fields that hold a time, or a hash over one."""

EVENTS = re.compile(r"events\.out\.tfevents\..*")
PLAYED = re.compile(r"played_\d+\.mcap")

ENDS = {".png": b"IEND\xaeB`\x82", ".svg": b"</svg>", ".html": b"</html>"}
"""Last bytes by a file's ending."""

Found = dict[str, Any]
"""Comparable contents by the name of a file."""


class HalfWrittenError(Exception):
    """A file under its final name that cannot be read."""


def contents(folder: Path) -> Found:
    """Read every file below a folder; a recording that was cut, a temporary file, a lock and events have no contents.

    Raises:
        HalfWrittenError: a file cannot be read.
    """
    found: Found = {}
    for path in (path for path in files(folder) if not EVENTS.fullmatch(path.name)):
        try:
            value = READERS.get(path.suffix, _hash)(path)
        except Exception as error:  # whatever a reader makes of half a file
            raise HalfWrittenError(f"{path.relative_to(folder)}: {type(error).__name__}: {error}") from error
        if value is not None:
            found[general(path, folder)] = value
    return found


def files(folder: Path) -> list[Path]:
    """Every file below a folder."""
    return sorted(path for path in folder.rglob("*") if path.is_file())


def general(path: Path, folder: Path) -> str:
    """The name of a file without what differs between two runs of a job."""
    name = path.relative_to(folder).as_posix().replace(f"{UNFINISHED}/", "")
    return PLAYED.sub("played.mcap", EVENTS.sub("events", name))


def _json(path: Path) -> object:
    data = _timeless(json.loads(path.read_text()))
    if path.name == CARD:
        load_core(path.parent)
    return data


def _timeless(data: object) -> object:
    if isinstance(data, Mapping):
        return {name: _timeless(value) for name, value in data.items() if name not in TIMES}
    return [_timeless(value) for value in data] if isinstance(data, list) else data


def _table(path: Path) -> list[dict[str, str]]:
    with path.open(newline="") as file:
        return [{name: text for name, text in row.items() if name not in TIMES} for row in csv.DictReader(file)]


def _tensors(path: Path) -> object:
    if path.name != CHECKPOINT:
        return _hash(path)
    state = load_state(path)
    session = {**state["session"], "spent": state["session"]["spent"][:2]}
    return _hashed({**state, "session": session, "tables": None})


def _hashed(node: object) -> object:
    """A state with hashes instead of tensors."""
    if isinstance(node, torch.Tensor):
        return hashlib.sha256(node.numpy().tobytes()).hexdigest()
    if isinstance(node, Mapping):
        return {str(name): _hashed(value) for name, value in node.items()}
    return [_hashed(value) for value in node] if isinstance(node, list) else node


def _recording(path: Path) -> object:
    found = recorded(path)
    return None if found.flaw else found.steps


def recorded(path: Path) -> Contents:
    """Read a recording; one that was killed before it wrote anything is empty."""
    return read(path) if path.stat().st_size else Contents(None, [], "is cut")


def _onnx(path: Path) -> str:
    import onnx  # noqa: PLC0415 - takes a second

    onnx.checker.check_model(onnx.load(path))
    return _hash(path)


def _hash(path: Path) -> str:
    if not path.stat().st_size:
        raise ValueError("it is empty")
    return hashlib.sha256(path.read_bytes()).hexdigest()


def _picture(path: Path) -> None:
    """A picture or a page, whose bytes may hold names and times, must have its end."""
    if not path.read_bytes().rstrip().endswith(ENDS[path.suffix]):
        raise ValueError("it has no end")


def _nothing(path: Path) -> None:
    """Neither read nor compared."""
    del path


READERS: Mapping[str, Callable[[Path], object]] = {
    ".json": _json,
    ".csv": _table,
    ".safetensors": _tensors,
    ".mcap": _recording,
    ".onnx": _onnx,
    **dict.fromkeys(ENDS, _picture),
    ".tmp": _nothing,
    "": _nothing,
}
"""By a file's ending; without one there are locks only."""
