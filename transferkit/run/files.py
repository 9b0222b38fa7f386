"""Writing files that are either there or not there, and states that load without running code."""

from __future__ import annotations

import contextlib
import json
import os
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import safetensors
import safetensors.torch
import torch

from transferkit.errors import RunDirectoryError

_TENSOR = "__tensor__"
_TREE = "tree"


def write_atomically(path: Path, data: bytes) -> None:
    """Replace `path` in one step: temporary file, fsync, rename.

    Raises:
        RunDirectoryError: the disk is full or the path not writable; what was at `path` before is still there.
    """
    temporary = path.with_name(path.name + ".tmp")
    with writing(path):
        try:
            with temporary.open("wb") as file:
                file.write(data)
                file.flush()
                os.fsync(file.fileno())
            temporary.replace(path)
        except OSError:
            temporary.unlink(missing_ok=True)
            raise


@contextlib.contextmanager
def writing(path: Path) -> Iterator[None]:
    """Turn an `OSError` while writing `path` into one line that says what to do."""
    try:
        yield
    except OSError as error:
        raise RunDirectoryError(
            f"cannot write {path}: {error.strerror}; what was written before is intact: mend the disk, then run the same "
            "command with --resume"
        ) from error


def write_json(path: Path, data: Any) -> None:  # noqa: ANN401 - any JSON value
    """Write strict JSON (no NaN), indented."""
    write_atomically(path, (json.dumps(data, indent=2, allow_nan=False) + "\n").encode())


def save_state(path: Path, state: Any) -> None:  # noqa: ANN401 - any nesting of dicts, lists, JSON values and tensors
    """Write nested dicts and lists of tensors and JSON values as one safetensors file."""
    tensors: dict[str, torch.Tensor] = {}
    tree = json.dumps(_strip(state, tensors))
    write_atomically(path, safetensors.torch.save(tensors, {_TREE: tree}))


def load_state(path: Path) -> Any:  # noqa: ANN401 - the inverse of save_state
    """Read what `save_state` wrote.

    Raises:
        RunDirectoryError: the file is not a state file, or is damaged.
    """
    with _reading(path) as file:
        tree = json.loads(file.metadata()[_TREE])
        tensors = {name: file.get_tensor(name) for name in file.keys()}  # noqa: SIM118 - not a dict
    return _fill(tree, tensors)


def check_state(path: Path) -> None:
    """Find out whether a state file is whole, without reading its tensors.

    Raises:
        RunDirectoryError: it is not a state file, or is damaged.
    """
    with _reading(path) as file:
        json.loads(file.metadata()[_TREE])


@contextlib.contextmanager
def _reading(path: Path) -> Iterator[Any]:
    try:
        with safetensors.safe_open(path, "pt") as file:
            yield file
    except (OSError, safetensors.SafetensorError, KeyError, TypeError, ValueError) as error:
        raise RunDirectoryError(f"{path} cannot be read: {error}; delete the run directory and train again") from error


def _strip(node: Any, tensors: dict[str, torch.Tensor]) -> Any:  # noqa: ANN401
    if isinstance(node, torch.Tensor):
        name = str(len(tensors))
        tensors[name] = node.detach().cpu().contiguous().clone()
        return {_TENSOR: name}
    if isinstance(node, dict):
        # Pairs, because an optimiser's state is keyed by integers.
        return {"pairs": [[key, _strip(value, tensors)] for key, value in node.items()]}
    if isinstance(node, list | tuple):
        return [_strip(value, tensors) for value in node]
    return node


def _fill(node: Any, tensors: dict[str, torch.Tensor]) -> Any:  # noqa: ANN401
    if isinstance(node, dict):
        if _TENSOR in node:
            return tensors[node[_TENSOR]]
        return {key: _fill(value, tensors) for key, value in node["pairs"]}
    if isinstance(node, list):
        return [_fill(value, tensors) for value in node]
    return node
