"""Recordings as experience that a trainer starts with."""

from __future__ import annotations

import hashlib
import logging
from collections.abc import Sequence
from dataclasses import fields
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from transferkit.record.datasets import SCHEME, read_minari
from transferkit.record.mapping import load_mapping, read_mapped
from transferkit.record.reader import Transitions, read_transitions

if TYPE_CHECKING:
    from transferkit.spec import IOSpec

LOGGER = logging.getLogger("transferkit")


def load_experience(names: Sequence[str], mapping: str | None, spec: IOSpec) -> tuple[Transitions, list[dict[str, Any]]]:
    """Load the steps of all recordings and datasets together, and for each its name, steps and hash.

    What is left out of a file is logged as a warning.

    Raises:
        RecordingError: one of them cannot be read, or does not fit the environment.
    """
    channels = None if mapping is None else load_mapping(Path(mapping))
    parts, ledger = [], []
    for name in names:
        if name.startswith(SCHEME):
            part = read_minari(name.removeprefix(SCHEME), spec)
        else:
            part = read_transitions(Path(name), spec) if channels is None else read_mapped(Path(name), channels, spec)
        for note in part.notes:
            LOGGER.warning(note)
        parts.append(part)
        digest = "" if name.startswith(SCHEME) else hashlib.sha256(Path(name).read_bytes()).hexdigest()
        ledger.append({"name": name, "steps": len(part), "sha256": digest})
    return joined(parts), ledger


def joined(parts: Sequence[Transitions]) -> Transitions:
    """Join them, one after the other."""
    names = [field.name for field in fields(Transitions) if field.name != "notes"]
    columns: dict[str, Any] = {name: np.concatenate([getattr(part, name) for part in parts]) for name in names}
    return Transitions(**columns)
