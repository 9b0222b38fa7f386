"""Named tensors as safetensors, which load without running code: checksums, and numbers that are all finite."""

from __future__ import annotations

import hashlib
import json
from collections.abc import Iterable, Mapping
from typing import Any

import safetensors
import safetensors.torch
import torch
from torch import Tensor

from transferkit.reading import FormatError, parse

LARGEST = 2**30
"""Bytes of a file of tensors."""

DTYPES = (torch.float32, torch.float64, torch.uint8, torch.int64, torch.bool)

_METADATA, _DIGEST = "__metadata__", "sha256"


def dump_tensors(tensors: Mapping[str, Tensor], metadata: Mapping[str, str]) -> bytes:
    """Write tensors and strings with a checksum of all of it."""
    header, data = _split(safetensors.torch.save(dict(tensors), dict(metadata)))
    header[_METADATA] = {**metadata, _DIGEST: _digest(header, data)}
    text = json.dumps(header).encode()
    text += b" " * (-len(text) % 8)  # tensors start at a multiple of 8
    return len(text).to_bytes(8, "little") + text + data


def parse_tensors(blob: bytes) -> tuple[dict[str, Tensor], dict[str, str]]:
    """Read tensors and strings, and their checksum if there is one: earlier versions wrote none.

    Raises:
        FormatError: the data is damaged, or a number is not finite.
    """
    header, data = _split(blob)
    metadata = header.get(_METADATA, {})
    recorded = metadata.pop(_DIGEST, None) if isinstance(metadata, dict) else None
    if recorded is not None and recorded != _digest(header, data):
        raise FormatError("it was changed: its checksum does not fit")
    try:
        tensors = dict(sorted(safetensors.torch.load(blob).items()))  # whose order is chance
    except (safetensors.SafetensorError, KeyError, ValueError, TypeError, RuntimeError, OverflowError) as error:
        raise FormatError(f"not safetensors: {' '.join(str(error).split())}") from None
    for name, tensor in tensors.items():
        if tensor.dtype not in DTYPES:
            raise FormatError(f"{name} has type {tensor.dtype}")
        if not torch.isfinite(tensor).all():
            raise FormatError(f"{name} has NaN or infinite numbers")
        if tensor.dtype == torch.float64 and not torch.isfinite(tensor.float()).all():
            raise FormatError(f"{name} has numbers that float32 cannot hold")
    return tensors, metadata


def check_enough(tensors: Iterable[Tensor], weights: int, what: str) -> None:
    """Check that there are as many numbers as an architecture has weights, before any of it is allocated.

    Raises:
        FormatError: there are fewer.
    """
    if weights > sum(tensor.numel() for tensor in tensors):
        raise FormatError(f"{what} has fewer numbers than its architecture")


def _split(blob: bytes) -> tuple[dict[str, Any], bytes]:
    """The header of a safetensors file, and the bytes behind it."""
    end = 8 + int.from_bytes(blob[:8], "little")
    if end > len(blob):
        raise FormatError("not safetensors: its header is cut")
    return parse(blob[8:end], dict[str, Any]), blob[end:]


def _digest(header: Mapping[str, Any], data: bytes) -> str:
    layout = hashlib.sha256(json.dumps(header, sort_keys=True).encode())
    layout.update(data)
    return layout.hexdigest()
