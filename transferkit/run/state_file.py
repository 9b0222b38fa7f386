"""States of training as safetensors files, which load without running code."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import torch

from transferkit.errors import NotFiniteError
from transferkit.files import damaged_run, write_atomically
from transferkit.reading import FormatError, parse, read_bytes
from transferkit.tensors import LARGEST, dump_tensors, parse_tensors

_TENSOR = "__tensor__"
_TREE = "tree"


def save_state(path: Path, state: object) -> None:
    """Write nested dicts and lists of tensors and JSON values as one safetensors file.

    Raises:
        NotFiniteError: a number outside the tensors is not finite; nothing is written.
    """
    tensors: dict[str, torch.Tensor] = {}
    try:
        tree = json.dumps(_without_tensors(state, tensors), allow_nan=False)
    except ValueError:
        raise NotFiniteError(
            f"training came to NaN or infinity, which {path} does not take", remedy="scale the rewards, or take smaller steps"
        ) from None
    write_atomically(path, dump_tensors(tensors, {_TREE: tree}))


def load_state(path: Path) -> dict[str, Any]:
    """Read what `save_state` wrote.

    Raises:
        RunDirectoryError: the file is not a state file, or is damaged.
    """
    with damaged_run(path):
        tensors, metadata = parse_tensors(read_bytes(path, LARGEST))
        if set(metadata) != {_TREE}:
            raise FormatError("it is not the state of a run")
        try:
            state = _with_tensors(parse(metadata[_TREE], dict[str, Any]), tensors)
        except (KeyError, TypeError, ValueError):
            raise FormatError("it is not the state of a run") from None
    return state


def check_alike(state: object, example: object, where: str = "state") -> None:
    """Compare a state with one of the same kind: names, types, and shapes but for what is empty in the example.

    Raises:
        FormatError: they differ.
    """
    if isinstance(example, dict) and isinstance(state, dict):
        for name in example.keys() & state.keys():
            check_alike(state[name], example[name], f"{where}.{name}")
    elif isinstance(example, list | tuple) and isinstance(state, list):
        if example and len(state) != len(example):
            raise FormatError(f"{where} has {len(state)} items instead of {len(example)}")
        for k, (one, other) in enumerate(zip(state, example, strict=False)):
            check_alike(one, other, f"{where}.{k}")
    elif isinstance(example, torch.Tensor) and isinstance(state, torch.Tensor):
        grows = int(example.dim() > 0 and len(example) == 0)
        same = state.dtype == example.dtype and state.dim() == example.dim() and state.shape[grows:] == example.shape[grows:]
        if not same:
            raise FormatError(f"{where} is {state.dtype} of shape {tuple(state.shape)} instead of {tuple(example.shape)}")
    elif type(state) is not type(example) and not (type(example) is float and type(state) is int):
        raise FormatError(f"{where} is {type(state).__name__} instead of {type(example).__name__}")


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
