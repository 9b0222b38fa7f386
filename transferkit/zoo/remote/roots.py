"""Which zoos elsewhere a user has added, and what of them is on this machine; nothing here uses the network."""

from __future__ import annotations

import hashlib
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any

from transferkit.errors import ConfigError
from transferkit.files import user_folder, write_atomically, write_json
from transferkit.reading import FormatError, parse, read_bytes, typed, unsealed
from transferkit.zoo.card import Sha256
from transferkit.zoo.remote.index import LARGEST_INDEX, Index, digest_of

LARGEST_LIST = 2**20
"""Bytes of the list of roots."""


@dataclass(frozen=True)
class Root:
    """A zoo elsewhere."""

    url: str
    expect: Sha256 | None = None
    """Digest of the only index that is believed; None for any."""

    def admits(self, data: bytes) -> bool:
        """Whether this index is the one that was signed off, if one was."""
        return self.expect in (None, digest_of(data))


@dataclass(frozen=True)
class _Roots:
    roots: tuple[Root, ...] = ()


def roots() -> list[Root]:
    """Return the zoos that were added, in that order.

    Raises:
        ConfigError: their list is damaged.
    """
    path = _list_file()
    try:
        return list(typed(unsealed(parse(read_bytes(path, LARGEST_LIST), dict[str, Any])), _Roots).roots)
    except FileNotFoundError:
        return []
    except (OSError, FormatError) as error:
        raise ConfigError(f"the list of zoos {path} is damaged ({error})", remedy="delete it, and add them again") from None


def remember(root: Root) -> None:
    """Add a root to the list, in place of what it said about the same URL."""
    _write([*(one for one in roots() if one.url != root.url), root])


def forget(url: str) -> Root:
    """Take a root off the list; what was pulled from it stays.

    Raises:
        ConfigError: it is not on it.
    """
    root = find_root(url)
    _write([one for one in roots() if one != root])
    return root


def find_root(url: str) -> Root:
    """Find a root by its URL.

    Raises:
        ConfigError: it was not added.
    """
    known = roots()
    for root in known:
        if root.url in (url.rstrip("/"), str(Path(url).absolute())):
            return root
    there = f"added are {', '.join(root.url for root in known)}" if known else "none was added"
    raise ConfigError(f"{url} is no zoo that was added; {there}", remedy=f"`transferkit zoo add {url}`")


def cached_index(root: Root) -> Index | None:
    """The index of a root as it was when it was last fetched; None if it is not here, damaged, or not the one expected."""
    try:
        data = read_bytes(_index_file(root), LARGEST_INDEX)
        return Index.from_bytes(data) if root.admits(data) else None
    except (OSError, FormatError):
        return None


def cache_index(root: Root, data: bytes) -> None:
    """Keep the bytes of an index."""
    path = _index_file(root)
    path.parent.mkdir(parents=True, exist_ok=True)
    write_atomically(path, data)


def cache_folder() -> Path:
    """Where everything that comes from other zoos lies."""
    return user_folder("XDG_CACHE_HOME", ".cache") / "zoo"


def pulled_folder(digest: str) -> Path:
    """The folder that holds a pulled core, by the digest of its card."""
    return cache_folder() / "cores" / digest


def pulled_folders() -> list[Path]:
    """The folders that hold one pulled core each; none for a user without a home."""
    try:
        cores = cache_folder() / "cores"
    except ConfigError:
        return []
    return sorted(path for path in cores.glob("*") if not path.name.startswith("."))


def _write(listed: list[Root]) -> None:
    path = _list_file()
    path.parent.mkdir(parents=True, exist_ok=True)
    write_json(path, asdict(_Roots(tuple(listed))))


def _list_file() -> Path:
    return user_folder("XDG_CONFIG_HOME", ".config") / "zoos.json"


def _index_file(root: Root) -> Path:
    return cache_folder() / "indices" / f"{hashlib.sha256(root.url.encode()).hexdigest()}.json"
