"""Parameters of SBX in flax's msgpack: `{"actor": ..., "qf": ...}`, as `flax.serialization.to_bytes` writes them."""

from __future__ import annotations

import math
import re
from collections.abc import Mapping
from typing import TYPE_CHECKING, Any

import msgspec
import numpy as np
import torch
from torch import Tensor

from transferkit.interop.foreign import Foreign, linear, tensor
from transferkit.reading import FormatError

if TYPE_CHECKING:
    from transferkit.interop.foreign import Layer

ARRAY = 1
"""flax's code of an array."""

TYPES = ("float32", "float64", "float16")


def read_flax(data: bytes) -> Foreign:
    """Read an actor of SBX's PPO, SAC, TD3 or DDPG, and the critics beside it.

    Raises:
        FormatError: it is damaged, or not a plain MLP.
    """
    try:
        saved = msgspec.msgpack.decode(data, ext_hook=_extension)
    except FormatError:
        raise
    except (msgspec.MsgspecError, ValueError, TypeError, RecursionError, OverflowError) as error:
        raise FormatError(f"not msgpack of flax: {' '.join(str(error).split())[:100]}") from None
    return foreign_of(saved)


def foreign_of(saved: object) -> Foreign:
    """Take the parameters of `actor`, and of `qf` if there are any, as tensors in nested tables.

    Raises:
        FormatError: they are not those of a plain MLP.
    """
    actor = _params(saved, "actor")
    layers, log_std = _dense(actor), actor.get("log_std")
    if not layers:
        raise FormatError('it has no actor; write {"actor": params, "qf": params}')
    if isinstance(log_std, Tensor):
        left_out = ["its critic values states alone and is left out"]
        return Foreign("SBX PPO", layers, None, 1.0, log_std=tensor(actor, "log_std").flatten(), notes=left_out)
    heads = [layer.weight.shape for layer in layers[-2:]]  # SAC has two beside each other: mean and log-std
    gaussian = len(layers) > 2 and heads[0] == heads[1] and heads[0][0] != heads[1][1]
    return Foreign(
        f"SBX {'SAC' if gaussian else 'TD3 or DDPG'}",
        layers[:-1] if gaussian else layers,
        None,
        "bounds",
        squash=True,
        critics=_critics(saved),
    )


def _extension(code: int, data: memoryview) -> object:
    """Read an array of numbers; anything else is left out."""
    if code != ARRAY:
        return None
    shape, name, raw = msgspec.msgpack.decode(bytes(data), type=tuple[tuple[int, ...], str, bytes])
    if name not in TYPES or any(size < 0 for size in shape) or math.prod(shape) * np.dtype(name).itemsize != len(raw):
        raise FormatError(f"an array of it has the type {name[:20]}, or another size than its shape")
    return torch.from_numpy(np.frombuffer(bytearray(raw), name).reshape(shape))


def _params(saved: object, name: str) -> Mapping[str, Any]:
    found = saved.get(name) if isinstance(saved, Mapping) else None
    inner = found.get("params", found) if isinstance(found, Mapping) else None
    return inner if isinstance(inner, Mapping) else {}


def _dense(params: Mapping[str, Any]) -> list[Layer]:
    """The layers `Dense_0`, `Dense_1`, ... with nothing unknown beside them."""
    if strange := [name for name in params if not re.fullmatch(r"Dense_\d+|log_std|log_std_init", name)]:
        raise FormatError(f"it has {strange[0]}; only plain MLPs are read")
    flat = {}
    for name, layer in params.items():
        if isinstance(layer, Mapping):
            flat[f"{name}.weight"] = layer["kernel"].T if isinstance(layer.get("kernel"), Tensor) else None
            flat[f"{name}.bias"] = layer.get("bias")
    return [linear(flat, name) for name in sorted((n for n in params if n[0] == "D"), key=lambda name: int(name[6:]))]


def _critics(saved: object) -> list[list[Layer]]:
    """Critics, whose layers have a leading axis over them."""
    params = _params(saved, "qf")
    while len(params) == 1 and not any(name.startswith("Dense_") for name in params):  # the name of flax's vmap
        (params,) = params.values()
        if not isinstance(params, Mapping):
            return []
    tensors = [value for layer in params.values() if isinstance(layer, Mapping) for value in layer.values()]
    if not tensors or not all(isinstance(value, Tensor) and value.dim() > 1 for value in tensors):
        return []
    count = min(len(value) for value in tensors)
    members = [
        {name: {kind: value[k] for kind, value in layer.items()} for name, layer in params.items()} for k in range(count)
    ]
    return [_dense(member) for member in members]
