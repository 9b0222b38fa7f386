"""States of training as safetensors files, which load without running code."""

from __future__ import annotations

import contextlib
import json
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import safetensors
import safetensors.torch
import torch

from transferkit.errors import RunDirectoryError
from transferkit.files import write_atomically

_TENSOR = "__tensor__"
_TREE = "tree"


def save_state(path: Path, state: object) -> None:
    """Write nested dicts and lists of tensors and JSON values as one safetensors file."""
    tensors: dict[str, torch.Tensor] = {}
    tree = json.dumps(_without_tensors(state, tensors))
    write_atomically(path, safetensors.torch.save(tensors, {_TREE: tree}))


def load_state(path: Path) -> dict[str, Any]:
    """Read what `save_state` wrote.

    Raises:
        RunDirectoryError: the file is not a state file, or is damaged.
    """
    with _reading(path) as file:
        tree = json.loads(file.metadata()[_TREE])
        tensors = {name: file.get_tensor(name) for name in list(file.keys())}
    return _with_tensors(tree, tensors)


def check_state(path: Path) -> None:
    """Check that a state file is whole, without reading its tensors.

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
        raise RunDirectoryError(
            f"{path} cannot be read ({error})", remedy="delete the run directory and train again"
        ) from error


def _without_tensors(node: object, tensors: dict[str, torch.Tensor]) -> object:
    if isinstance(node, torch.Tensor):
        name = str(len(tensors))
        tensors[name] = node.detach().cpu().contiguous().clone()
        return {_TENSOR: name}
    if isinstance(node, dict):
        # Pairs, because an optimiser's state is keyed by integers.
        return {"pairs": [[key, _without_tensors(value, tensors)] for key, value in node.items()]}
    if isinstance(node, list | tuple):
        return [_without_tensors(value, tensors) for value in node]
    return node


def _with_tensors(node: Any, tensors: dict[str, torch.Tensor]) -> Any:  # noqa: ANN401 - JSON
    if isinstance(node, dict):
        if _TENSOR in node:
            return tensors[node[_TENSOR]]
        return {key: _with_tensors(value, tensors) for key, value in node["pairs"]}
    if isinstance(node, list):
        return [_with_tensors(value, tensors) for value in node]
    return node
