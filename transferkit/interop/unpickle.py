"""Pickles of strangers as data: what they refer to is never imported and never called.

Named things become numbers by functions of this package, or stand-ins without behaviour. What is neither refuses the file.
"""

from __future__ import annotations

import io
import pickle
import pickletools
from collections.abc import Callable, Collection, Mapping
from typing import Any

from transferkit.reading import FormatError

LARGEST = 64 * 2**20
"""Bytes of a pickle."""

MEMO = ("PUT", "BINPUT", "LONG_BINPUT")
EXTENSIONS = ("EXT1", "EXT2", "EXT4")


class Inert:
    """A stand-in for an object of another library: keeps its state, does nothing."""

    def __init__(self, *args: object, **kwargs: object) -> None:
        del kwargs
        self.args, self.state = args, {}

    def __setstate__(self, state: object) -> None:
        """Keep the state."""
        self.state = state if isinstance(state, dict) else {}

    def __setitem__(self, key: object, value: object) -> None:
        """Forget an item."""

    def append(self, value: object) -> None:
        """Forget an element."""

    def extend(self, values: object) -> None:
        """Forget elements."""


class Mute(Inert):
    """A stand-in for a function too, whose results are such again."""

    def __call__(self, *args: object, **kwargs: object) -> Mute:
        """Stand for a result."""
        return Mute(*args, **kwargs)


def unpickle(
    data: bytes,
    makers: Mapping[str, Any],
    inert: Collection[str] | None,
    persistent: Callable[[Any], Any] | None = None,
) -> Any:  # noqa: ANN401 - whatever data it holds
    """Read a pickle.

    Args:
        data: all of it.
        makers: what stands for a name of it, `module.name`.
        inert: packages whose other names become stand-ins; None for all, and also for what they would have made.
        persistent: makes what stands outside of the pickle.

    Raises:
        FormatError: it is damaged, or refers to anything else.
    """
    _check_opcodes(data)
    reader = _Reader(data, makers, inert, persistent)
    try:
        return reader.load()
    except FormatError:
        raise
    except Exception as error:  # damage can meet any operation
        raise FormatError(f"its pickle is damaged: {type(error).__name__}: {' '.join(str(error).split())[:100]}") from None


class _Reader(pickle.Unpickler):
    def __init__(
        self, data: bytes, makers: Mapping[str, Any], inert: Collection[str] | None, persistent: Callable[[Any], Any] | None
    ) -> None:
        super().__init__(io.BytesIO(data))
        self._makers, self._inert, self._persistent = makers, inert, persistent

    def find_class(self, module: str, name: str) -> Any:  # noqa: ANN401
        full = f"{module}.{name}"
        if full in self._makers:
            return self._makers[full]
        if self._inert is None:
            return type("Mute", (Mute,), {"name": full})
        if module.partition(".")[0] in self._inert:
            return type("Inert", (Inert,), {"name": full})
        raise FormatError(f"it refers to {full}, which is not data; nothing of it was run")

    def persistent_load(self, pid: Any) -> Any:  # noqa: ANN401
        if self._persistent is None:
            raise FormatError("its pickle refers to something outside of it")
        return self._persistent(pid)


def _check_opcodes(data: bytes) -> None:
    """Check that lengths are within the pickle and that its memo has no gaps, before anything is allocated."""
    if len(data) > LARGEST:
        raise FormatError(f"its pickle has {len(data):,} bytes, at most {LARGEST:,} are read")
    try:
        for count, (opcode, argument, _) in enumerate(pickletools.genops(data)):
            if (opcode.name in MEMO and int(str(argument)) > count) or opcode.name in EXTENSIONS:
                raise FormatError("its pickle was not written by pickle")
    except FormatError:
        raise
    except (ValueError, TypeError, LookupError, OverflowError, MemoryError) as error:
        raise FormatError(f"its pickle is damaged: {' '.join(str(error).split())[:100]}") from None
