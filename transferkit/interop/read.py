"""Recognise the file of another library, and make a core of it in memory."""

from __future__ import annotations

import hashlib
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING

from transferkit.errors import ArtifactError, ConfigError
from transferkit.files import MISFITS, others_file
from transferkit.interop.archive import Archive
from transferkit.interop.build import build_core
from transferkit.interop.cleanrl import is_cleanrl, read_cleanrl
from transferkit.interop.described import described
from transferkit.interop.rsl_rl_file import is_rsl_rl, read_rsl_rl
from transferkit.interop.sb3 import is_sb3, read_sb3
from transferkit.interop.statistics import read_statistics
from transferkit.interop.torch_file import is_torch, read_torch
from transferkit.reading import FormatError, read_bytes

if TYPE_CHECKING:
    from transferkit.interop.foreign import Foreign, Given, Statistics
    from transferkit.policy.core import Core
    from transferkit.spec import IOSpec

LARGEST = 256 * 2**20
"""Bytes of a file."""

NONE = "none"

READ = "files of Stable-Baselines3 (.zip), rsl_rl and CleanRL (torch.save), ONNX (.onnx) and flax (.msgpack)"


def read_core(path: Path, spec: IOSpec, given: Given, name: str) -> tuple[Core, Foreign, list[str]]:
    """Make a core of a file; also returns what the file holds, and what was assumed or left out.

    Args:
        path: the file.
        spec: of the environment that the policy was trained in.
        given: what the file does not say.
        name: of the core.

    Raises:
        ArtifactError: it is damaged, of another format, or holds what no core can be.
        ConfigError: it does not say something, and `given` does not either.
        DimensionError: it does not fit the environment.
    """
    try:
        with others_file(path):
            data = read_bytes(path, LARGEST)
            foreign = _foreign(data, path.suffix)
            if given.stats is not None or foreign.normalized is None:
                foreign = replace(foreign, statistics=_statistics(foreign, given))
            foreign, said = described(foreign, spec, given)
            core, notes = build_core(foreign, spec, given, name, hashlib.sha256(data).hexdigest())
    except MISFITS as error:
        raise ArtifactError(f"{path} is damaged ({type(error).__name__}: {' '.join(str(error).split())[:200]})") from None
    return core, foreign, [*said, *notes]


def _foreign(data: bytes, suffix: str) -> Foreign:
    """Read whatever library's file it is."""
    if suffix in (".onnx", ".msgpack"):
        from transferkit.interop.flax_file import read_flax  # noqa: PLC0415 - of few files
        from transferkit.interop.onnx_file import read_onnx  # noqa: PLC0415 - onnx is an extra

        return (read_onnx if suffix == ".onnx" else read_flax)(data)
    if data[:2] != b"PK":
        raise FormatError(f"it is not a zip; read are {READ}, and torch's older pickles once saved again")
    archive = Archive(data)
    if is_sb3(archive):
        return read_sb3(archive)
    if not is_torch(archive):
        raise FormatError(f"its zip is of an unknown kind; read are {READ}")
    saved = read_torch(archive)
    if is_rsl_rl(saved):
        return read_rsl_rl(saved)
    if is_cleanrl(saved):
        return read_cleanrl(saved)
    raise FormatError(f"its names are not those of a known policy; read are {READ}")


def _statistics(foreign: Foreign, given: Given) -> Statistics | None:
    if given.stats is None:
        raise ConfigError(
            "the file does not say whether observations were normalised", remedy="give {stats=FILE}, or {stats=none} if not"
        )
    if foreign.statistics is not None:
        raise ConfigError("the file has observation statistics of its own", remedy="leave out {stats}")
    if str(given.stats) == NONE:
        return None
    with others_file(given.stats):
        return read_statistics(read_bytes(Path(given.stats), LARGEST))
