"""Minari datasets out of recordings, and transitions out of Minari datasets; the extra `minari`."""

from __future__ import annotations

import importlib
import logging
import re
import shutil
import warnings
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from pathlib import Path
from types import ModuleType
from typing import TYPE_CHECKING, Any

import numpy as np
from gymnasium.spaces import Box
from numpy.typing import NDArray

from transferkit.errors import RecordingError
from transferkit.record.reader import Transitions, check_finite, read, read_transitions, spec_of

if TYPE_CHECKING:
    from transferkit.spec import IOSpec

LOGGER = logging.getLogger("transferkit")

SCHEME = "minari:"
"""Prefix of a dataset's name among files: `minari:namespace/name-v0`."""


def export_minari(paths: Sequence[Path], dataset: str) -> int:
    """Write recordings of one environment as a local Minari dataset; returns its steps.

    Raises:
        RecordingError: Minari is not installed, the dataset exists or has no version in its name, or the recordings do not
            fit together.
    """
    if not re.fullmatch(r"(\w[\w-]*/)*\w[\w-]*-v\d{1,9}", dataset, re.ASCII):  # Minari fails after it has made the folder
        raise RecordingError("Minari dataset", value=dataset, allowed="a name with a version, such as hopper/mine-v0")
    minari = _minari()
    spec = spec_of(read(paths[0], about_only=True), paths[0])
    buffers = [buffer for path in paths for buffer in _whole_episodes(path, spec)]
    if not buffers:
        raise RecordingError(f"{paths[0]} holds no whole episode", remedy="record it again", topic="recordings")
    try:
        with _new(dataset), warnings.catch_warnings():
            warnings.simplefilter("ignore")  # one for every piece of metadata that a user may add
            minari.create_dataset_from_buffers(
                dataset,
                buffers,
                observation_space=Box(-np.inf, np.inf, (spec.obs_dim,), np.float32),
                action_space=Box(-1.0, 1.0, (spec.act_dim,), np.float32),
                description=f"Recorded with transferkit in {spec.env_id}; actions are shares of the actuators' ranges.",
            )
    except (ValueError, OSError, AssertionError) as error:
        reason = (str(error).splitlines() or [type(error).__name__])[0]
        raise RecordingError(f"cannot write the Minari dataset {dataset}: {reason}", remedy="choose another {minari}") from None
    return sum(len(buffer.rewards) for buffer in buffers)


@contextmanager
def _new(dataset: str) -> Iterator[None]:
    """If anything fails nothing of a dataset is left that would take its name."""
    folder = importlib.import_module("minari.storage").get_dataset_path(dataset)
    new = not folder.exists()
    try:
        yield
    except BaseException:
        if new:
            shutil.rmtree(folder, ignore_errors=True)
        raise


def read_minari(dataset: str, spec: IOSpec) -> Transitions:
    """Read the steps of a local Minari dataset with flat observations and actions of this spec's dimensions.

    Raises:
        RecordingError: Minari is not installed, there is no such dataset, or its dimensions do not fit.
    """
    minari = _minari()
    try:
        loaded = minari.load_dataset(dataset)
        episodes = list(loaded.iterate_episodes())
    except Exception as error:  # whatever Minari and h5py raise for what is no dataset
        reason = (str(error).splitlines() or [type(error).__name__])[0]
        raise RecordingError(f"no Minari dataset {dataset} here ({reason})", remedy="`minari list local` lists them") from None
    columns = _columns(episodes, dataset)
    for what, array, dim in (("observation", columns[0], spec.obs_dim), ("action", columns[1], spec.act_dim)):
        if array.shape[1:] != (dim,):
            raise RecordingError(f"Minari dataset {dataset} has {what}s of shape {array.shape[1:]}, {spec.env_id} has ({dim},)")
    columns[1] = _shares(columns[1], loaded.action_space)
    floats = [column.astype(np.float32) for column in columns[:4]]
    transitions = Transitions(*floats, terminated=columns[4].astype(bool), truncated=columns[5].astype(bool))
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


def _shares(actions: NDArray[Any], space: Box) -> NDArray[Any]:
    """Turn actions into shares of their space's range, as everywhere here; leave them as they are if it has no bounds."""
    if not isinstance(space, Box) or not (np.isfinite(space.low).all() and np.isfinite(space.high).all()):
        return actions
    centre, half = (space.high + space.low) / 2, (space.high - space.low) / 2
    return np.clip((actions - centre) / half, -1.0, 1.0)


def _whole_episodes(path: Path, spec: IOSpec) -> list[Any]:
    """Read the episodes of a recording that ended, as Minari's buffers; what is left out is logged."""
    transitions = read_transitions(path, spec)
    whole = _buffers(transitions)
    left = len(transitions) - sum(len(buffer.rewards) for buffer in whole)
    for note in transitions.notes:
        LOGGER.warning(note)
    if left:
        LOGGER.warning("%s: %d steps of an episode without an end are left out", path, left)
    return whole


def _buffers(transitions: Transitions) -> list[Any]:
    kind = importlib.import_module("minari.data_collector").EpisodeBuffer
    ends = np.flatnonzero(transitions.terminated | transitions.truncated) + 1
    starts = [0, *ends[:-1].tolist()]
    return [
        kind(
            id=k,
            observations=[*transitions.observation[a:b], transitions.next_observation[b - 1]],
            actions=list(transitions.action[a:b]),
            rewards=transitions.reward[a:b].tolist(),
            terminations=transitions.terminated[a:b].tolist(),
            truncations=transitions.truncated[a:b].tolist(),
        )
        for k, (a, b) in enumerate(zip(starts, ends.tolist(), strict=False))
    ]


def _minari() -> ModuleType:
    try:
        return importlib.import_module("minari")
    except ImportError:
        raise RecordingError("Minari is not installed", remedy="pip install 'transferkit[minari]'") from None
