"""Cores from this machine into a zoo elsewhere, which never changes one that it has."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

from transferkit.errors import ArtifactError, RemoteError
from transferkit.reading import FormatError
from transferkit.zoo.artifact import load_core
from transferkit.zoo.card import README, read_card
from transferkit.zoo.readme import render
from transferkit.zoo.remote.index import FILES, INDEX, LARGEST_INDEX, Entry, File, Index, digest_of
from transferkit.zoo.remote.transport import Transport
from transferkit.zoo.summary import Summary


def push(folder: Path, url: str) -> tuple[str, str]:
    """Copy a core to a zoo and enter it into the index; returns its id and the digest of the index.

    Whoever pushes to the same zoo at the same moment has to push again: stores of files have no locks.

    Raises:
        ArtifactError: it is no sound core, or the zoo has one of its id.
        ConfigError: nobody writes to such a URL.
        RemoteError: the zoo cannot be reached, or its index is damaged.
    """
    transport = Transport(url)
    if not transport.writable:
        raise RemoteError(f"{url} cannot be written", remedy="push to a folder, s3://, gs:// or hf://")
    card = read_card(folder)
    load_core(folder)
    _check_new(_index(transport), card.id, url)
    files = {name: (folder / name).read_bytes() for name in FILES}
    for name, data in (*files.items(), (README, render(card).encode())):
        transport.write(f"{card.id}/{name}", data)
    index = _index(transport)  # of now
    _check_new(index, card.id, url)
    entry = Entry({name: File.of(data) for name, data in files.items()}, Summary.of(card))
    data = replace(index, cores={**index.cores, card.id: entry}).to_bytes()
    transport.write(INDEX, data)
    return card.id, digest_of(data)


def _index(transport: Transport) -> Index:
    """The index as it is, empty at first."""
    data = transport.read(INDEX, LARGEST_INDEX)
    try:
        return Index() if data is None else Index.from_bytes(data)
    except FormatError as error:
        raise RemoteError(f"the index of {transport.url} is not read: {error}") from None


def _check_new(index: Index, name: str, url: str) -> None:
    if name in index.cores:
        raise ArtifactError(f"{url} has a core {name}, which is never rewritten", remedy="choose a higher version for it")
