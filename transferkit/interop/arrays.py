"""numpy's arrays and numbers in pickles, made without numpy's own functions."""

from __future__ import annotations

import codecs
import math
import re
from typing import Any

import numpy as np
from numpy.typing import NDArray

from transferkit.interop.unpickle import Inert
from transferkit.reading import FormatError

NUMBERS = re.compile(r"[fiu][1248]|b1")


class DType:
    """A type of numbers by its code, such as `f8`."""

    def __init__(self, code: object = "", *_: object) -> None:
        self.code, self.order = str(code).lstrip("<>=|"), str(code)[:1] if str(code)[:1] == ">" else "<"

    def __setstate__(self, state: object) -> None:
        """Take over the byte order."""
        if isinstance(state, tuple) and len(state) > 1 and state[1] == ">":
            self.order = ">"

    def read(self, data: object, shape: object) -> NDArray[np.float64]:
        """Read bytes as an array of this shape.

        Raises:
            FormatError: they are no numbers, or of another size.
        """
        sizes = [n for n in (shape if isinstance(shape, tuple | list) else (shape,)) if type(n) is int and n >= 0]
        if not isinstance(data, bytes | bytearray) or not NUMBERS.fullmatch(self.code):
            raise FormatError("an array of it has no numbers")
        flat = np.frombuffer(data, np.dtype(self.order + self.code))
        if math.prod(sizes) != flat.size or (isinstance(shape, tuple | list) and len(sizes) < len(shape)):
            raise FormatError("an array of it has another size than its shape")
        return flat.reshape(sizes).astype(np.float64)


class Array(Inert):
    """An array; of other things than numbers it stays empty."""

    value: NDArray[np.float64] | None = None

    def __setstate__(self, state: object) -> None:
        """Read numpy's state: version, shape, type, order, bytes."""
        if isinstance(state, tuple) and len(state) == 5 and isinstance(state[2], DType) and isinstance(state[4], bytes):
            _, shape, dtype, fortran, data = state
            if NUMBERS.fullmatch(dtype.code):
                value = dtype.read(data, tuple(reversed(shape)) if fortran else shape)
                self.value = value.T if fortran else value


def _scalar(dtype: object, data: object = b"") -> object:
    readable = isinstance(dtype, DType) and NUMBERS.fullmatch(dtype.code)
    return float(dtype.read(data, ())) if readable and isinstance(dtype, DType) else Inert()


def _from_buffer(data: object, dtype: object, shape: object, order: object = "C") -> Array:
    array = Array()
    if isinstance(dtype, DType) and isinstance(shape, tuple):
        array.__setstate__((1, shape, dtype, order == "F", bytes(data) if isinstance(data, bytes | bytearray) else b""))
    return array


def _encode(text: object, *_: object) -> bytes:
    return codecs.encode(text, "latin1") if isinstance(text, str) else b""


MAKERS: dict[str, Any] = {"numpy.dtype": DType, "_codecs.encode": _encode}
for _module in ("numpy._core", "numpy.core"):
    MAKERS |= {
        f"{_module}.multiarray._reconstruct": Array,
        f"{_module}.multiarray.scalar": _scalar,
        f"{_module}.numeric._frombuffer": _from_buffer,
    }
