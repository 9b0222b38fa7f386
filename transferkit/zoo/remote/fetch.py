"""Indices and cores from zoos elsewhere into the cache of this machine."""

from __future__ import annotations

import contextlib
import logging
import shutil
from pathlib import Path
from typing import TYPE_CHECKING

from transferkit.errors import ArtifactError, ConfigError, RemoteError, UnknownNameError
from transferkit.files import write_atomically, writing
from transferkit.reading import FormatError
from transferkit.zoo.artifact import load_core
from transferkit.zoo.card import CARD, README, read_card
from transferkit.zoo.catalog import core_folders
from transferkit.zoo.readme import render
from transferkit.zoo.remote.index import FILES, INDEX, LARGEST_INDEX, File, Index, digest_of
from transferkit.zoo.remote.roots import cache_folder, cache_index, cached_index, find_root, pulled_folder, roots
from transferkit.zoo.remote.transport import Transport

if TYPE_CHECKING:
    from collections.abc import Sequence

    from transferkit.zoo.remote.index import Entry
    from transferkit.zoo.remote.roots import Root
    from transferkit.zoo.remote.transport import Report


def refresh(root: Root) -> tuple[Index, str]:
    """Fetch the index of a root and keep it; returns it with its digest.

    Raises:
        ConfigError: nobody reads such a URL.
        RemoteError: there is none, it cannot be read, or it is not the one that is expected.
    """
    data = Transport(root.url).read(INDEX, LARGEST_INDEX)
    if data is None:
        raise RemoteError(f"{root.url} is no zoo: it has no {INDEX}", remedy="`transferkit zoo push FOLDER URL` makes one")
    if not root.admits(data):
        raise RemoteError(
            f"the index of {root.url} has the digest {digest_of(data)}, and {root.expect} is expected",
            remedy=f"once you trust it, `transferkit zoo add {root.url}` with its digest",
        )
    try:
        index = Index.from_bytes(data)
    except FormatError as error:
        raise RemoteError(f"the index of {root.url} is not read: {error}") from None
    cache_index(root, data)
    return index, digest_of(data)


def current(root: Root) -> Index | None:
    """The index of a root, fetched; where that fails, which is said, as it was; None if it was never here."""
    try:
        return refresh(root)[0]
    except RemoteError as error:
        index = cached_index(root)
        known = "nothing is known of it" if index is None else "its index is taken as it was"
        logging.getLogger("transferkit").warning("%s; %s", error, known)
        return index


def pull(name: str, url: str | None, report: Report) -> Path:
    """Bring a core into the cache, where it is found by its id; returns its folder.

    Args:
        name: its id.
        url: of the zoo that has it; None asks all that were added.
        report: is told how many bytes of a file are there.

    Raises:
        ArtifactError: another core of that id is here, or what came is no sound core.
        RemoteError: a zoo cannot be reached or does not keep to its index.
        UnknownNameError: no zoo has it.
    """
    root, entry = _holder(name, roots() if url is None else [find_root(url)])
    if (here := core_folders().get(name)) is not None:
        if File.of((here / CARD).read_bytes()) != entry.files[CARD]:
            raise ArtifactError(f"there is another core {name} in {here}", remedy="move that one out of the way")
        return here
    folder = pulled_folder(entry.digest) / name
    _download(name, entry, Transport(f"{root.url}/{name}"), folder, report)
    return folder


def _holder(name: str, asked: Sequence[Root]) -> tuple[Root, Entry]:
    found = [(root, index.cores) for root in asked if (index := current(root)) is not None]
    having = [(root, cores[name]) for root, cores in found if name in cores]
    if not found:
        raise ConfigError(
            f"unknown core of zoos elsewhere '{name}': no zoo was added", remedy="`transferkit zoo add URL` adds one"
        )
    if not having:
        raise UnknownNameError("core of zoos elsewhere", name, sorted({core for _, cores in found for core in cores}))
    if len({entry.digest for _, entry in having}) > 1:
        raise ArtifactError(
            f"{' and '.join(root.url for root, _ in having)} have different cores {name}", remedy="say which with {from=URL}"
        )
    return having[0]


def _download(name: str, entry: Entry, transport: Transport, folder: Path, report: Report) -> None:
    """Fetch the files one by one, put them into a folder beside, and publish that once it is a sound core."""
    parts, beside = cache_folder() / "parts", folder.parent.with_name(f".{folder.parent.name}")
    with writing(folder):
        parts.mkdir(parents=True, exist_ok=True)
    for file in FILES:
        transport.download(file, entry.files[file], parts / entry.files[file].sha256, report)
    with writing(folder):
        shutil.rmtree(beside, ignore_errors=True)
        (beside / name).mkdir(parents=True)
        for file in FILES:
            shutil.copyfile(parts / entry.files[file].sha256, beside / name / file)
        try:
            card = read_card(beside / name)
            if card.id != name:
                raise ArtifactError(f"the card of {name} is of {card.id}")
            write_atomically(beside / name / README, render(card).encode())
            load_core(beside / name)
        except ArtifactError:
            shutil.rmtree(beside, ignore_errors=True)
            raise
        with contextlib.suppress(OSError):  # another process was faster
            beside.rename(folder.parent)
        if not (folder / CARD).exists():
            raise RemoteError(f"{folder} cannot be made")
        for file in FILES:
            (parts / entry.files[file].sha256).unlink(missing_ok=True)
