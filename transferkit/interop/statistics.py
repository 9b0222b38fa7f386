"""Observation statistics that lie beside a policy: Stable-Baselines3's VecNormalize, or the arrays of an npz file."""

from __future__ import annotations

import io
import math
from collections.abc import Mapping
from typing import Any

import numpy as np
import torch
from numpy.typing import NDArray

from transferkit.interop import arrays
from transferkit.interop.archive import Archive
from transferkit.interop.foreign import Statistics
from transferkit.interop.unpickle import Inert, unpickle
from transferkit.reading import FormatError

EPSILON, CLIP = 1e-8, 10.0
"""What VecNormalize and CleanRL use by default, for an npz file that does not say."""

VEC_NORMALIZE = "stable_baselines3.common.vec_env.vec_normalize.VecNormalize"
INERT = ("stable_baselines3", "gymnasium", "gym", "numpy", "collections")


def read_statistics(data: bytes) -> Statistics | None:
    """Read a VecNormalize pickle, or an npz file with `mean`, `var` and perhaps `count`, `epsilon` and `clip`.

    None if it normalised rewards only.

    Raises:
        FormatError: it is neither, or damaged.
    """
    return _arrays(data) if data[:2] == b"PK" else _vec_normalize(data)


def _vec_normalize(data: bytes) -> Statistics | None:
    found = unpickle(data, arrays.MAKERS, INERT)
    if not isinstance(found, Inert) or getattr(found, "name", "") != VEC_NORMALIZE:
        raise FormatError("it is not a VecNormalize of Stable-Baselines3")
    state = found.state
    if state.get("norm_obs") is not True:
        return None
    running = state.get("obs_rms")
    if not isinstance(running, Inert):
        raise FormatError("its observations are a dictionary; only flat ones are read")
    epsilon, clip = (_positive(state.get(name), name) for name in ("epsilon", "clip_obs"))
    return _statistics(running.state, epsilon, clip)


def _arrays(data: bytes) -> Statistics:
    archive, found = Archive(data), {}
    for member in archive.names:
        name = member.removesuffix(".npy")
        if name in ("mean", "var", "count", "epsilon", "clip"):
            found[name] = _array(archive.read(member), name)
    epsilon, clip = (_positive(found.get(name, usual), name) for name, usual in (("epsilon", EPSILON), ("clip", CLIP)))
    return _statistics(found, epsilon, clip)


def _array(data: bytes, name: str) -> NDArray[np.generic]:
    """Read one array of numpy's format, once its header is known to fit its bytes."""
    try:
        file = io.BytesIO(data)
        read_header = {(1, 0): np.lib.format.read_array_header_1_0, (2, 0): np.lib.format.read_array_header_2_0}
        shape, _, dtype = read_header[np.lib.format.read_magic(file)](file)
        if math.prod(shape) * dtype.itemsize > len(data):
            raise FormatError(f"its {name} is cut")
        return np.lib.format.read_array(io.BytesIO(data), allow_pickle=False)
    except FormatError:
        raise
    except Exception as error:  # of numpy, over damage
        raise FormatError(f"its {name} is not an array: {' '.join(str(error).split())[:100]}") from None


def _statistics(state: Mapping[str, Any], epsilon: float, clip: float) -> Statistics:
    mean, var = (_numbers(state.get(name), name) for name in ("mean", "var"))
    if mean.shape != var.shape or bool((var < 0).any()):
        raise FormatError("its mean and variance differ in shape, or a variance is negative")
    return Statistics(mean, var + epsilon, clip, _positive(state.get("count", 1.0), "count"))


def _numbers(value: object, name: str) -> torch.Tensor:
    array = value.value if isinstance(value, arrays.Array) else value
    if not isinstance(array, np.ndarray) or array.dtype.kind not in "fiu" or array.ndim != 1 or not np.isfinite(array).all():
        raise FormatError(f"its {name} is not a list of finite numbers")
    return torch.from_numpy(array.astype(np.float64))


def _positive(value: Any, name: str) -> float:  # noqa: ANN401
    array = value.value if isinstance(value, arrays.Array) else value
    number = array.item() if isinstance(array, np.ndarray) and array.size == 1 else array
    if isinstance(number, bool) or not isinstance(number, int | float) or not 0 <= number < 1e15:
        raise FormatError(f"its {name} is not a number that is not negative")
    return float(number)
