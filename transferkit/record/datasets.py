"""Minari datasets out of recordings, and transitions out of Minari datasets; the extra `minari`."""

from __future__ import annotations

import logging
import warnings
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np

from transferkit.errors import RecordingError
from transferkit.record.reader import Transitions, check_finite, read, read_transitions, spec_of
from transferkit.spec import IOSpec

LOGGER = logging.getLogger("transferkit")

SCHEME = "minari:"
"""How a dataset is named where a file could stand: `minari:namespace/name-v0`."""


def export_minari(paths: Sequence[Path], dataset: str) -> int:
    """Write recordings of one environment as a local Minari dataset; returns its steps.

    Raises:
        RecordingError: Minari is not installed, the dataset exists, or the recordings do not fit together.
    """
    minari = _minari()
    from gymnasium.spaces import Box  # noqa: PLC0415

    spec = spec_of(read(paths[0], about_only=True), paths[0])
    buffers = []
    for path in paths:
        found = read_transitions(path, spec)
        whole = _episodes(found)
        left = len(found) - sum(len(episode.rewards) for episode in whole)
        for note in (*found.notes, *([f"{path}: {left} steps of an episode without an end are left out"] if left else [])):
            LOGGER.warning(note)
        buffers += whole
    if not buffers:
        raise RecordingError(f"{paths[0]} holds no whole episode; record it again with `transferkit record`")
    try:
        with warnings.catch_warnings():
            warnings.simplefilter("ignore")  # one for every piece of metadata that a user may add
            minari.create_dataset_from_buffers(
                dataset,
                buffers,
                observation_space=Box(-np.inf, np.inf, (spec.obs_dim,), np.float32),
                action_space=Box(-1.0, 1.0, (spec.act_dim,), np.float32),
                description=f"Recorded with transferkit in {spec.env_id}; actions are shares of the actuators' ranges.",
            )
    except (ValueError, FileExistsError, AssertionError) as error:
        raise RecordingError(
            f"cannot write the Minari dataset {dataset}: {str(error).splitlines()[0]}; pass another --minari"
        ) from None
    return sum(len(buffer.rewards) for buffer in buffers)


def read_minari(dataset: str, spec: IOSpec) -> Transitions:
    """The steps of a local Minari dataset with flat observations and actions of this spec's dimensions.

    Raises:
        RecordingError: Minari is not installed, there is no such dataset, or its dimensions do not fit.
    """
    minari = _minari()
    try:
        loaded = minari.load_dataset(dataset)
    except (FileNotFoundError, ValueError) as error:
        raise RecordingError(
            f"no Minari dataset {dataset} here ({str(error).splitlines()[0]}); `minari list local` lists them"
        ) from None
    episodes = list(loaded.iterate_episodes())
    if not episodes:
        raise RecordingError(f"Minari dataset {dataset} has no episode; pass another")
    try:
        parts = [
            (e.observations[:-1], e.actions, e.rewards, e.observations[1:], e.terminations, e.truncations) for e in episodes
        ]
        columns = [np.concatenate(column) for column in zip(*parts, strict=True)]
    except (TypeError, KeyError, ValueError):
        raise RecordingError(
            f"Minari dataset {dataset} has observations or actions that are no flat arrays; pass another"
        ) from None
    for what, array, dim in (("observation", columns[0], spec.obs_dim), ("action", columns[1], spec.act_dim)):
        if array.shape[1:] != (dim,):
            raise RecordingError(f"Minari dataset {dataset} has {what}s of shape {array.shape[1:]}, {spec.env_id} has ({dim},)")
    columns[1] = _shares(columns[1], loaded.action_space)
    floats = [column.astype(np.float32) for column in columns[:4]]
    found = Transitions(*floats, terminated=columns[4].astype(bool), truncated=columns[5].astype(bool))
    check_finite(found, Path(f"{SCHEME}{dataset}"))
    return found


def _shares(actions: Any, space: Any) -> Any:  # noqa: ANN401 - arrays, and gymnasium's Box
    """Actions as shares of their space's range, as everywhere here; as they are where that has no bounds."""
    if not (np.isfinite(space.low).all() and np.isfinite(space.high).all()):
        return actions
    centre, half = (space.high + space.low) / 2, (space.high - space.low) / 2
    return np.clip((actions - centre) / half, -1.0, 1.0)


def _episodes(found: Transitions) -> list[Any]:
    """The episodes that ended."""
    from minari.data_collector import EpisodeBuffer  # type: ignore[import-not-found] # noqa: PLC0415

    ends = np.flatnonzero(found.terminated | found.truncated) + 1
    starts = [0, *ends[:-1].tolist()]
    return [
        EpisodeBuffer(
            id=k,
            observations=[*found.observation[a:b], found.next_observation[b - 1]],
            actions=list(found.action[a:b]),
            rewards=found.reward[a:b].tolist(),
            terminations=found.terminated[a:b].tolist(),
            truncations=found.truncated[a:b].tolist(),
        )
        for k, (a, b) in enumerate(zip(starts, ends.tolist(), strict=False))
    ]


def _minari() -> Any:  # noqa: ANN401 - a module
    try:
        import minari  # type: ignore[import-not-found] # noqa: PLC0415 - an extra
    except ImportError:
        raise RecordingError("Minari is not installed; pip install 'transferkit[minari]'") from None
    return minari
