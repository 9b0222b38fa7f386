"""Transitions out of Minari datasets; the extra `minari`."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
from gymnasium.spaces import Box
from numpy.typing import NDArray

from transferkit.errors import RecordingError, reason_of
from transferkit.extras import import_extra
from transferkit.record.reader import Transitions, check_finite

if TYPE_CHECKING:
    from transferkit.spec import IOSpec

SCHEME = "minari:"
"""Prefix of a dataset's name among files: `minari:namespace/name-v0`."""

ROUNDING = 1e-6
"""Of actions in float32 at the bounds of their space."""


def read_minari(dataset: str, spec: IOSpec) -> Transitions:
    """Read the steps of a local Minari dataset with flat observations and actions of this spec's dimensions.

    Raises:
        ConfigError: Minari cannot be imported.
        RecordingError: there is no such dataset, or its dimensions do not fit.
    """
    minari = import_extra("minari", "minari", "a dataset")
    try:
        loaded = minari.load_dataset(dataset)
        episodes = list(loaded.iterate_episodes())
    except Exception as error:  # whatever Minari and h5py raise for what is no dataset
        why = f"no Minari dataset {dataset} here ({reason_of(error)})"
        raise RecordingError(why, remedy="`minari list local` lists them") from None
    columns = _columns(episodes, dataset)
    for what, array, dim in (("observation", columns[0], spec.obs_dim), ("action", columns[1], spec.act_dim)):
        if array.shape[1:] != (dim,):
            raise RecordingError(f"Minari dataset {dataset} has {what}s of shape {array.shape[1:]}, {spec.env_id} has ({dim},)")
    columns[1], notes = _shares(columns[1], loaded.action_space, dataset)
    floats = [column.astype(np.float32) for column in columns[:4]]
    transitions = Transitions(*floats, terminated=columns[4].astype(bool), truncated=columns[5].astype(bool), notes=notes)
    check_finite(transitions, Path(f"{SCHEME}{dataset}"))
    return transitions


def _columns(episodes: Sequence[Any], dataset: str) -> list[NDArray[Any]]:
    """Observation, action, reward, next observation, terminated and truncated of all steps."""
    if not episodes:
        raise RecordingError(f"Minari dataset {dataset} has no episode", remedy="choose another")
    try:
        parts = [
            (e.observations[:-1], e.actions, e.rewards, e.observations[1:], e.terminations, e.truncations) for e in episodes
        ]
        return [np.concatenate(column) for column in zip(*parts, strict=True)]
    except (TypeError, KeyError, ValueError):
        raise RecordingError(
            f"Minari dataset {dataset} has observations or actions that are not flat arrays", remedy="choose another"
        ) from None


def _shares(actions: NDArray[Any], space: object, dataset: str) -> tuple[NDArray[Any], tuple[str, ...]]:
    """Turn actions into shares of their space's range, as everywhere here; leave them as they are if it has no bounds."""
    if not isinstance(space, Box) or not space.is_bounded():
        return actions, ()
    low, high = space.low.astype(np.float64), space.high.astype(np.float64)
    shares = (actions - (low + high) / 2) / ((high - low) / 2)
    beyond = int((np.abs(shares) > 1 + ROUNDING).any(axis=1).sum())
    note = f"Minari dataset {dataset}: {beyond} actions beyond the bounds of their space are clipped"
    return np.clip(shares, -1.0, 1.0), (note,) * bool(beyond)
