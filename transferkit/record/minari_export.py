"""Recordings as a Minari dataset whose environment comes back and gives the same numbers; the extra `minari`.

Actions are float64 in the environment's own units, as `make_env` handed them on. Observations are taken from the
environment that Minari will recover, simulated again, because a recording has them in float32 only. Where that does not
give what was recorded, the recorded ones are written, and it is said.
"""

from __future__ import annotations

import copy
import importlib
import itertools
import logging
import re
import shutil
import warnings
from collections.abc import Iterator, Sequence
from contextlib import closing, contextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any

import gymnasium
import numpy as np
from gymnasium.envs.registration import EnvSpec
from numpy.typing import NDArray

from transferkit.envs import NO_LIMIT, dims, episode_limit, id_from_file, is_written, make_env
from transferkit.errors import RecordingError, reason_of
from transferkit.extras import import_extra
from transferkit.record.format import Names
from transferkit.record.reader import about_of, check_spec, read
from transferkit.record.replay import different_versions
from transferkit.streams import Streams

if TYPE_CHECKING:
    from transferkit.record.format import About, Step

LOGGER = logging.getLogger("transferkit")

Env = gymnasium.Env[Any, Any]


@dataclass(frozen=True)
class Episode:
    """A recorded episode from its reset to its end."""

    path: Path
    about: About
    steps: Sequence[Step]

    @property
    def seed(self) -> int:
        """What the environment was reset with."""
        return Streams(self.about.seed).episode(self.steps[0].episode)

    def observations(self) -> NDArray[np.float32]:
        """Return the recorded ones, `(steps + 1, obs_dim)`."""
        names = Names.of(self.about.spec).observation
        last = self.steps[-1].next_observation or {}
        return self._rows([*(step.observation for step in self.steps), last], names)

    def actions(self) -> NDArray[np.float32]:
        """Return what the policy chose, `(steps, act_dim)`."""
        return self._rows([step.action for step in self.steps], Names.of(self.about.spec).action)

    def rewards(self) -> list[float]:
        """Return the rewards of the steps."""
        return self._finite(np.array([step.reward for step in self.steps])).tolist()

    def _rows(self, rows: Sequence[dict[str, float]], names: Sequence[str]) -> NDArray[np.float32]:
        try:
            return self._finite(np.array([[row[name] for name in names] for row in rows], np.float32))
        except KeyError as error:
            raise RecordingError(f"{self.path}: a step lacks {error}", remedy="record it again", topic="recordings") from None

    def _finite(self, values: NDArray[Any]) -> NDArray[Any]:
        if not np.isfinite(values).all():
            raise RecordingError(f"{self.path} has NaN or infinity in an episode", remedy="record it again")
        return values


def export_minari(paths: Sequence[Path], dataset: str, *, env: str | None = None) -> int:
    """Write recordings of one environment as a local Minari dataset; returns its steps.

    Args:
        paths: the recordings.
        dataset: its name, with a version.
        env: names the recordings' environment, which is needed if its id imports a module.

    Raises:
        ConfigError: Minari cannot be imported.
        RecordingError: the dataset exists or has no version in its name, or the recordings do not fit together.
        EnvironmentContractError: the environment cannot be made, or needs a module that was not named.
    """
    if not re.fullmatch(r"(\w[\w-]*/)*\w[\w-]*-v\d{1,9}", dataset, re.ASCII):  # Minari fails after it has made the folder
        raise RecordingError("Minari dataset", value=dataset, allowed="a name with a version, such as hopper/mine-v0")
    minari = import_extra("minari", "minari", "a dataset")
    episodes = [episode for path in paths for episode in _whole_episodes(path)]
    if not episodes:
        raise RecordingError(f"{paths[0]} holds no whole episode", remedy="record it again", topic="recordings")
    about = _common(episodes)
    if is_written(about.spec.env_id) and env not in (None, about.spec.env_id):
        raise RecordingError(
            f"{paths[0]} was recorded in {about.spec.env_id}, not in {env}", remedy=f"use {{env={about.spec.env_id}}}"
        )
    with closing(make_env(id_from_file(about.spec.env_id, paths[0], env), **about.rules)) as made:
        if dims(made) != (about.spec.obs_dim, about.spec.act_dim):
            raise RecordingError(f"{paths[0]} was recorded in another version of {about.spec.env_id}", remedy="record it again")
        raw, actions = made.env, [made.scaled(episode.actions()) for episode in episodes]
        spec = _recoverable(raw, about)
        observations = _observations(spec, episodes, actions)
        buffers = [_buffer(*parts, raw) for parts in zip(itertools.count(), episodes, observations, actions)]
        with _new(dataset):
            minari.create_dataset_from_buffers(
                dataset,
                buffers,
                env=spec,
                observation_space=raw.observation_space,
                action_space=raw.action_space,
                description=_description(about, actions, raw.action_space),
                requirements=_requirements(episodes, spec),
            )
    return sum(len(buffer.rewards) for buffer in buffers)


@contextmanager
def _new(dataset: str) -> Iterator[None]:
    """If anything fails nothing of a dataset is left that would take its name."""
    folder = importlib.import_module("minari.storage").get_dataset_path(dataset)
    new = not folder.exists()
    try:
        with warnings.catch_warnings():
            warnings.simplefilter("ignore")  # one for every piece of metadata that a user may add
            yield
    except BaseException as error:
        if new:
            shutil.rmtree(folder, ignore_errors=True)
        if isinstance(error, (ValueError, OSError, AssertionError)):
            raise RecordingError(
                f"cannot write the Minari dataset {dataset}: {reason_of(error)}", remedy="choose another {minari}"
            ) from None
        raise


def _whole_episodes(path: Path) -> list[Episode]:
    """Read the episodes that are there from their reset to their end; what is left out is logged."""
    contents = read(path)
    about = about_of(contents, path, "a dataset needs its seeds; record episodes with transferkit")
    groups = (list(steps) for _, steps in itertools.groupby(contents.steps, lambda step: step.episode))
    whole = [
        Episode(path, about, steps)
        for steps in groups
        if steps[0].step == 0 and steps[-1].ended and all(a.precedes(b) for a, b in itertools.pairwise(steps))
    ]
    left = len(contents.steps) - sum(len(episode.steps) for episode in whole)
    if contents.flaw or left:
        flaw = f" {contents.flaw}" if contents.flaw else ""
        LOGGER.warning("%s%s: %d steps of episodes without a beginning or an end are left out", path, flaw, left)
    return whole


def _common(episodes: Sequence[Episode]) -> About:
    """Take what all recordings say of themselves.

    Raises:
        RecordingError: they were made in different environments, or under different rules.
    """
    first = episodes[0]
    for episode in episodes:
        check_spec(episode.about.spec, first.about.spec, episode.path)
        for rule in ("clip_actions", "max_episode_steps"):
            ours, other = getattr(first.about, rule), getattr(episode.about, rule)
            if ours != other:
                raise RecordingError(
                    f"{first.path} was recorded with {rule} {ours}, {episode.path} with {other}", remedy="export them apart"
                )
    return first.about


def _recoverable(raw: Env, about: About) -> EnvSpec | None:
    """Describe the environment as readers of the dataset will make it, with the time limit; None if that is impossible."""
    limits = (about.max_episode_steps or (NO_LIMIT if episode_limit(raw) is None else None), episode_limit(raw))
    try:
        if raw.spec is None:
            raise ValueError("it has no spec")
        spec = copy.deepcopy(raw.spec)
        spec.max_episode_steps = min(limit for limit in limits if limit is not None)
        spec = EnvSpec.from_json(spec.to_json())
        gymnasium.make(spec).close()
    except Exception as error:  # of the user's environment, or of what JSON cannot hold
        LOGGER.warning("the dataset cannot recover its environment %s: %s", about.spec.env_id, reason_of(error))
        return None
    return spec


def _observations(
    spec: EnvSpec | None, episodes: Sequence[Episode], actions: Sequence[NDArray[np.float64]]
) -> list[NDArray[Any]]:
    """Simulate the episodes again for observations of full precision; take the recorded ones where that differs."""
    if spec is None:
        return [episode.observations() for episode in episodes]
    found, differences = [], []
    with closing(gymnasium.make(spec)) as env:
        for episode, own in zip(episodes, actions, strict=True):
            observations, difference = _simulated(env, episode, own)
            found.append(episode.observations() if difference else observations)
            differences += [difference] * bool(difference)
    if differences:
        others = {name: pair for episode in episodes for name, pair in different_versions(episode.about).items()}
        why = ", ".join(f"{name} {recorded} recorded, {here} here" for name, (recorded, here) in others.items())
        LOGGER.warning(
            "%d of %d episodes are not reproduced here, first in %s (%s): their observations are the recorded ones",
            *(len(differences), len(episodes), differences[0], why or "the versions are the same"),
        )
    return found


def _simulated(env: Env, episode: Episode, actions: NDArray[np.float64]) -> tuple[NDArray[Any], str]:
    """Play an episode's actions from its seed; returns the observations, and where they or a reward first differ."""
    recorded, rows, at = episode.observations(), [], "its reset"
    try:
        rows.append(np.array(env.reset(seed=episode.seed)[0]))
        for step, action in zip(episode.steps, actions, strict=True):
            if not np.array_equal(rows[-1].astype(np.float32), recorded[len(rows) - 1]):
                break
            at = f"step {step.step}"
            observation, reward, terminated, truncated, _ = env.step(action)
            rows.append(np.array(observation))
            ended = (bool(terminated), bool(terminated or truncated))
            if float(reward) != step.reward or ended != (step.terminated, step.ended):
                break
        else:
            if np.array_equal(rows[-1].astype(np.float32), recorded[-1]):
                return np.stack(rows), ""
    except Exception as error:  # of the user's environment
        at = f"{at} with {type(error).__name__}"
    return recorded, f"{at} of episode {episode.steps[0].episode} of {episode.path}"


def _buffer(index: int, episode: Episode, observations: NDArray[Any], actions: NDArray[np.float64], raw: Env) -> Any:  # noqa: ANN401
    buffer = importlib.import_module("minari.data_collector").EpisodeBuffer
    return buffer(
        id=index,
        seed=episode.seed,
        observations=list(observations.astype(raw.observation_space.dtype)),
        actions=list(actions),
        rewards=episode.rewards(),
        terminations=[step.terminated for step in episode.steps],
        truncations=[step.truncated for step in episode.steps],
    )


def _description(about: About, actions: Sequence[NDArray[np.float64]], space: Any) -> str:  # noqa: ANN401 - a Box
    text = f"Recorded with transferkit in {about.spec.env_id}; actions are in the environment's own units."
    beyond = sum(int(((rows < space.low) | (rows > space.high)).any(axis=1).sum()) for rows in actions)
    if beyond:
        LOGGER.warning("%d actions were applied beyond the environment's bounds, and are in the dataset as they were", beyond)
        text += f" {beyond} of them are beyond its bounds, as they were applied."
    return text


def _requirements(episodes: Sequence[Episode], spec: EnvSpec | None) -> list[str]:
    """Name the versions that all recordings were made with, which Minari compares with those at hand."""
    suite = spec is not None and str(spec.entry_point).startswith("envs_dmc")
    names = ("mujoco", "gymnasium", *(("dm-control", "shimmy") if suite else ()))
    pinned = []
    for name in names:
        recorded = {episode.about.versions.get(name, "") for episode in episodes}
        pinned += [f"{name}=={version}" for version in recorded if len(recorded) == 1 and re.fullmatch(r"\d[\w.]*", version)]
    return pinned + ["transferkit"] * suite
