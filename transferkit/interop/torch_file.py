"""torch's zip files, read without torch's unpickler: tensors, plain values, and stand-ins for the rest."""

from __future__ import annotations

import math
from collections import OrderedDict
from collections.abc import Sequence
from typing import TYPE_CHECKING, Any

import torch
from torch import Tensor

from transferkit.interop import arrays
from transferkit.interop.unpickle import unpickle
from transferkit.reading import FormatError

if TYPE_CHECKING:
    from transferkit.interop.archive import Archive

STORAGES = {
    "torch.FloatStorage": torch.float32,
    "torch.DoubleStorage": torch.float64,
    "torch.HalfStorage": torch.float16,
    "torch.BFloat16Storage": torch.bfloat16,
    "torch.LongStorage": torch.int64,
    "torch.IntStorage": torch.int32,
    "torch.ShortStorage": torch.int16,
    "torch.CharStorage": torch.int8,
    "torch.ByteStorage": torch.uint8,
    "torch.BoolStorage": torch.bool,
}
INERT = ("torch", "numpy", "collections")
PICKLE = "/data.pkl"


def is_torch(archive: Archive) -> bool:
    """Whether a zip is one of `torch.save`'s."""
    return any(name.endswith(PICKLE) and name.count("/") == 1 for name in archive.names)


def read_torch(archive: Archive) -> Any:  # noqa: ANN401 - whatever was saved
    """Read what `torch.save` wrote.

    Raises:
        FormatError: it is damaged, holds code, or refers to anything but data.
    """
    root = next(name[: -len(PICKLE)] for name in archive.names if name.endswith(PICKLE))
    if f"{root}/constants.pkl" in archive.names:
        raise FormatError("it is TorchScript, which holds code; save the state_dict of the policy")
    if f"{root}/byteorder" in archive.names and archive.read(f"{root}/byteorder") != b"little":
        raise FormatError("its numbers are big-endian")
    storages = _Storages(archive, root)
    makers = {
        "collections.OrderedDict": OrderedDict,
        "torch._utils._rebuild_tensor_v2": _rebuild,
        "torch._utils._rebuild_parameter": _parameter,
        "torch.Size": tuple,
        **STORAGES,
        **arrays.MAKERS,
    }
    return unpickle(archive.read(f"{root}{PICKLE}"), makers, INERT, storages)


class _Storages:
    """Flat tensors by their key, each read once."""

    def __init__(self, archive: Archive, root: str) -> None:
        self._archive, self._root, self._read = archive, root, {}

    def __call__(self, pid: object) -> Tensor:
        if not (isinstance(pid, tuple) and len(pid) == 5 and pid[0] == "storage" and isinstance(pid[1], torch.dtype)):
            raise FormatError("it refers to a storage of an unknown kind")
        _, dtype, key, _, _ = pid
        if key not in self._read:
            data = self._archive.read(f"{self._root}/data/{key}")
            if len(data) % dtype.itemsize:
                raise FormatError(f"its storage {key} is cut")
            self._read[key] = torch.frombuffer(bytearray(data), dtype=dtype) if data else torch.empty(0, dtype=dtype)
        storage = self._read[key]
        if storage.dtype != dtype:
            raise FormatError(f"its storage {key} is read as two types")
        return storage


def _rebuild(storage: object, offset: object, size: object, stride: object, *_: object) -> Tensor:
    """Take a tensor of a storage, no larger than that."""
    if not isinstance(storage, Tensor) or not all(_whole(numbers) for numbers in ((offset,), size, stride)):
        raise FormatError("a tensor of it has no storage or no shape")
    assert isinstance(offset, int)
    sizes, strides = tuple(size), tuple(stride)  # pyright: ignore[reportArgumentType] - checked above
    count = math.prod(sizes)
    last = offset + sum((n - 1) * step for n, step in zip(sizes, strides, strict=True))
    if count and (count > storage.numel() or last >= storage.numel()):
        raise FormatError("a tensor of it is larger than its storage")
    return storage.as_strided(sizes, strides, offset) if count else storage.new_empty(sizes)


def _whole(numbers: object) -> bool:
    return isinstance(numbers, Sequence) and all(type(n) is int and 0 <= n < 2**40 for n in numbers) and len(numbers) < 9


def _parameter(data: object, *_: object) -> object:
    return data
