"""Atomic file writes, JSON files, and checks of output paths."""

from __future__ import annotations

import contextlib
import errno
import json
import os
from collections.abc import Iterator, Mapping
from pathlib import Path
from typing import Any, TypeVar

from transferkit.errors import ArtifactError, ConfigError, RunDirectoryError
from transferkit.reading import FormatError, parse, read_bytes, sealed, typed, unsealed

T = TypeVar("T")

LARGEST = 16 * 2**20
"""Bytes of a JSON file."""


def check_new(path: Path, option: str, *endings: str) -> None:
    """Check that a file does not exist but its folder does, before any work is done for it.

    Raises:
        ConfigError: the file exists, its folder does not, or its name has another ending.
    """
    if endings and path.suffix not in endings:
        raise ConfigError(
            f"ending of {path}", value=path.suffix, allowed=" or ".join(endings), remedy=f"choose another {{{option}}}"
        )
    if path.exists():
        raise ConfigError(f"{path} exists", remedy=f"choose another {{{option}}}")
    if not path.parent.is_dir():
        raise ConfigError(
            f"cannot write {path}: no folder {path.parent}", remedy=f"choose an {{{option}}} in a folder that exists"
        )


def check_folder(path: Path, option: str) -> None:
    """Check that a folder is there or can be made, before any work is done for it.

    Raises:
        ConfigError: a file is in its way, or it cannot be written.
    """
    nearest = next(place for place in (path, *path.parents) if os.path.lexists(place))  # also a link to nothing
    if not nearest.is_dir():
        raise ConfigError(f"{nearest} is not a folder", remedy=f"choose another {{{option}}}")
    if not os.access(nearest, os.W_OK):
        raise ConfigError(f"{nearest} cannot be written", remedy=f"choose another {{{option}}}")


@contextlib.contextmanager
def replacing(path: Path) -> Iterator[Path]:
    """A temporary file to write, which takes the place of `path` at the end; if anything fails nothing of it is left."""
    temporary = path.with_name(path.name + ".tmp")
    try:
        temporary.unlink(missing_ok=True)  # of a killed process, or a link to elsewhere
        yield temporary
        temporary.replace(path)
    except BaseException:
        temporary.unlink(missing_ok=True)
        raise


@contextlib.contextmanager
def new_file(path: Path, option: str) -> Iterator[Path]:
    """A temporary file to write for a user's `option`; there is either all of it in the end or nothing.

    Raises:
        ConfigError: it cannot be written.
    """
    try:
        with replacing(path) as temporary:
            yield temporary
    except OSError as error:
        reason = error.strerror or str(error).split("\n", 1)[0]
        raise ConfigError(f"cannot write {path}: {reason}", remedy=f"choose another {{{option}}}") from None


def write_atomically(path: Path, data: bytes) -> None:
    """Replace `path` in one step: temporary file, fsync, rename.

    Raises:
        RunDirectoryError: the disk is full or the path is not writable; what was at `path` before is still there.
    """
    with writing(path), replacing(path) as temporary, temporary.open("wb") as file:
        file.write(data)
        file.flush()
        os.fsync(file.fileno())


@contextlib.contextmanager
def writing(path: Path) -> Iterator[None]:
    """Turn an `OSError` while `path` is written into one line that says what to do."""
    try:
        yield
    except OSError as error:
        named = error.errno in (errno.ENAMETOOLONG, errno.ELOOP, errno.EEXIST, errno.ENOTDIR)
        raise RunDirectoryError(
            f"cannot write {path}: {error.strerror}; what was written before is intact",
            remedy="choose another name" if named else "mend the disk; the same command goes on, training with {resume=True}",
        ) from error


def write_json(path: Path, data: Mapping[str, Any]) -> None:
    """Write strict JSON (no NaN), indented, with a digest of its content."""
    write_atomically(path, (json.dumps(sealed(data), indent=2, allow_nan=False) + "\n").encode())


def read_json(path: Path, kind: type[T]) -> T:
    """Read a JSON file of a run as a value of this type, after its digest if it has one.

    Raises:
        RunDirectoryError: it is missing or damaged.
    """
    with damaged_run(path):
        return typed(unsealed(parse(read_bytes(path, LARGEST), dict[str, Any])), kind)


@contextlib.contextmanager
def others_file(path: str | Path) -> Iterator[None]:
    """Turn what is wrong with a file that another library wrote into one line that names it, while it is read."""
    try:
        yield
    except FileNotFoundError:
        raise ArtifactError(f"there is no file {path}") from None
    except OSError as error:
        raise ArtifactError(f"{path} cannot be read: {error.strerror}") from None
    except FormatError as error:
        raise ArtifactError(f"{path} is not read: {error}") from None


def user_folder(variable: str, usual: str) -> Path:
    """Transferkit's folder under a base folder of the XDG specification, such as `XDG_CACHE_HOME`, or under its usual one.

    Raises:
        ConfigError: neither is known.
    """
    try:
        return Path(os.environ.get(variable) or Path.home() / usual) / "transferkit"
    except RuntimeError:  # a user without a home
        raise ConfigError("this user has no home folder", remedy=f"set {variable} or HOME to a folder") from None


MISFITS = (ValueError, TypeError, LookupError, AttributeError, ArithmeticError, RuntimeError)
"""What data of the right types can still raise where it is taken over: torch's and numpy's words for what does not fit."""


@contextlib.contextmanager
def damaged_run(path: Path) -> Iterator[None]:
    """Turn what is wrong with a run's file into one line that names it, while it is read and taken over."""
    try:
        yield
    except FileNotFoundError:
        raise RunDirectoryError(f"{path.parent} holds no {path.name}", remedy="name the directory of a training run") from None
    except OSError as error:
        raise RunDirectoryError(f"{path} cannot be read: {error.strerror}") from None
    except MISFITS as error:
        reason = str(error) if isinstance(error, FormatError) else f"{type(error).__name__}: {error}"
        raise RunDirectoryError(
            f"{path} is damaged ({' '.join(reason.split())[:200]})", remedy="train again into another {out}"
        ) from None
