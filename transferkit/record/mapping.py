"""Transitions from the MCAP files of other tools, by a mapping in TOML.

```toml
[observation]                 # a step for every message of this topic
topic = "/joint_states"
fields = ["position.slider", "velocity.0"]      # a path per element, numbers count list entries

[action]                      # the first message from the step's time on, and before the next step's
topic = "/command"
fields = ["data.0"]

[reward]
topic = "/reward"
field = "value"

[terminated]                  # may be left out: then nothing ends before the file does
topic = "/done"
field = "value"
```
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np
from mcap.records import Channel, Message, Schema
from numpy.typing import NDArray

from transferkit.errors import RecordingError
from transferkit.reading import FormatError, parse_toml, read_bytes
from transferkit.record.mcap_file import Damage, records
from transferkit.record.messages import Decoder, number
from transferkit.record.reader import Transitions, check_finite

if TYPE_CHECKING:
    from transferkit.spec import IOSpec

OPTIONAL = ("terminated", "truncated")

LARGEST = 2**20
"""Bytes of a mapping."""


@dataclass(frozen=True)
class Source:
    """The place of a quantity."""

    topic: str
    fields: tuple[str, ...] = ()
    field: str | None = None

    def __post_init__(self) -> None:
        if bool(self.fields) == (self.field is not None):
            raise ValueError(f"the table of topic {self.topic} needs either fields or a field")
        object.__setattr__(self, "fields", self.fields or (self.field,))


@dataclass(frozen=True)
class ChannelMap:
    """The place of every quantity."""

    observation: Source
    action: Source
    reward: Source
    terminated: Source | None = None
    truncated: Source | None = None

    def sources(self) -> dict[str, Source]:
        """Those that are there, by name."""
        return {name: source for name, source in vars(self).items() if source is not None}


@dataclass(frozen=True)
class Series:
    """Values of a topic over time, each row at its log time."""

    times: NDArray[np.int64]
    values: NDArray[np.float64]


@dataclass(frozen=True)
class Logged:
    """What a mapping finds in a file: a row for each message of the observation's topic, in the order of time."""

    times: NDArray[np.int64]
    """Log times in nanoseconds."""
    observation: NDArray[np.float64]
    action: NDArray[np.float64]
    """NaN where none was logged before the next observation, as in the reward."""
    reward: NDArray[np.float64]
    complete: NDArray[np.bool_]
    """Whether an action and a reward were logged."""
    terminated: NDArray[np.bool_]
    truncated: NDArray[np.bool_]
    damaged: bool
    """Some of the file is lost."""

    def episodes(self) -> NDArray[np.int64]:
        """Count, for each row, the ends before it."""
        ends = np.cumsum(self.terminated | self.truncated)
        return np.concatenate(([0], ends[:-1]))


def load_mapping(path: Path) -> ChannelMap:
    """Read a mapping.

    Raises:
        RecordingError: no such file, not TOML, or a table that is missing or unknown.
    """
    try:
        return parse_toml(read_bytes(path, LARGEST), ChannelMap)
    except OSError as error:
        raise RecordingError(f"cannot read the mapping {path}: {error.strerror}", topic="mappings") from None
    except FormatError as error:
        raise RecordingError(f"the mapping {path} is none: {error}", topic="mappings") from None


def read_logged(path: Path, channels: ChannelMap) -> Logged:
    """Read what a mapping names, of a file of any tool and any dimensions.

    Raises:
        RecordingError: not an MCAP file, a topic or field that is not in it, or no observation.
    """
    mapping = channels.sources()
    series, damaged = _series(path, mapping)
    times = series["observation"].times
    if not len(times):
        raise RecordingError(f"{path} has no message on {mapping['observation'].topic}: no step can be made of it")
    rows = {name: _of_steps(series[name], times) for name in mapping if name != "observation"}
    action, reward = (_at(series[name], rows[name]) for name in ("action", "reward"))
    terminated, truncated = (_flag(series.get(name), rows.get(name), len(times)) for name in OPTIONAL)
    complete = (rows["action"] >= 0) & (rows["reward"] >= 0)
    return Logged(times, series["observation"].values, action, reward, complete, terminated, truncated, damaged=damaged)


def read_mapped(path: Path, channels: ChannelMap, spec: IOSpec) -> Transitions:
    """Read the steps of a file of any tool, for an environment of this spec.

    Raises:
        RecordingError: not an MCAP file, a topic or field that is not in it, dimensions that do not fit, NaN, or no steps.
    """
    mapping = channels.sources()
    for name, dim in (("observation", spec.obs_dim), ("action", spec.act_dim), ("reward", 1)):
        if len(mapping[name].fields) != dim:
            raise RecordingError(
                f"the mapping names {len(mapping[name].fields)} {name} fields, {spec.env_id} has {dim}", remedy="name as many"
            )
    logged = read_logged(path, channels)
    followed = np.arange(len(logged.times)) < len(logged.times) - 1
    unknown = logged.complete & ~logged.terminated & (logged.truncated | ~followed)
    steps = np.flatnonzero(logged.complete & ~unknown)
    if not len(steps):
        raise RecordingError(
            f"{path} has no step with an action and a reward between its observation and the next", remedy="check the topics"
        )
    observation = logged.observation.astype(np.float32)
    action, reward = (values[steps].astype(np.float32) for values in (logged.action, logged.reward))
    if np.abs(action).max() > 1:
        raise RecordingError(
            f"{path} has actions beyond -1 to 1 on {mapping['action'].topic}", remedy="log shares of the actuators' ranges"
        )
    terminated, truncated = logged.terminated[steps], logged.truncated[steps]
    # The next message is that of another episode; what a termination led to is not needed, since nothing follows it.
    following = observation[np.where(terminated, steps, steps + 1)]
    notes = _notes(path, len(steps), int((~logged.complete & followed).sum()), int(unknown.sum()), damaged=logged.damaged)
    transitions = Transitions(observation[steps], action, reward[:, 0], following, terminated, truncated, notes)
    check_finite(transitions, path)
    return transitions


def _at(series: Series, rows: NDArray[np.int64]) -> NDArray[np.float64]:
    """Take the rows of a series, NaN for -1."""
    if not len(series.times):
        return np.full((len(rows), series.values.shape[1]), np.nan)
    return np.where(rows[:, None] >= 0, series.values[rows], np.nan)


def _notes(path: Path, taken: int, lacking: int, unknown: int, *, damaged: bool) -> tuple[str, ...]:
    said = {
        f"{path} is cut or damaged: {taken} steps are taken": damaged,
        f"{path}: {lacking} steps lack an action or a reward and are left out": lacking,
        f"{path}: {unknown} steps that ended by time or with the file are left out, for it lacks what they led to": unknown,
    }
    return tuple(note for note, holds in said.items() if holds)


def _flag(series: Series | None, rows: NDArray[np.int64] | None, steps: int) -> NDArray[np.bool_]:
    """Find whether an end was logged for each step; without a series every step went on."""
    if series is None or rows is None or not len(series.times):
        return np.zeros(steps, bool)
    return (rows[:steps] >= 0) & (series.values[rows[:steps], 0] > 0.5)


def _series(path: Path, mapping: dict[str, Source]) -> tuple[dict[str, Series], bool]:
    """Read every mapped quantity over time, and whether some of the file is lost."""
    rows: dict[str, list[tuple[int, list[float]]]] = {name: [] for name in mapping}
    by_topic: dict[str, list[str]] = {}
    for name, source in mapping.items():
        by_topic.setdefault(source.topic, []).append(name)
    schemas: dict[int, Schema] = {}
    channels: dict[int, Channel] = {}
    seen, damaged, decode = set(), False, Decoder(path)
    for record in records(path):
        if isinstance(record, Damage):
            damaged = True
        elif isinstance(record, Schema):
            schemas[record.id] = record
        elif isinstance(record, Channel):
            channels[record.id] = record
            seen.add(record.topic)
        elif isinstance(record, Message) and record.channel_id in channels and channels[record.channel_id].topic in by_topic:
            channel = channels[record.channel_id]
            if record.log_time >= 2**63:
                raise RecordingError(f"{path}: a message on {channel.topic} has no time")
            message = decode(channel, schemas.get(channel.schema_id), record.data)
            for name in by_topic[channel.topic]:
                rows[name].append((record.log_time, [number(message, field, channel.topic) for field in mapping[name].fields]))
    for name, source in mapping.items():
        if source.topic not in seen:
            raise RecordingError(
                f"{path} has no topic {source.topic}, which [{name}] names", remedy=f"it has {', '.join(sorted(seen))}"
            )
    return {name: _sorted(own, len(mapping[name].fields)) for name, own in rows.items()}, damaged


def _sorted(rows: Sequence[tuple[int, list[float]]], width: int) -> Series:
    ordered = sorted(rows, key=lambda row: row[0])
    times = np.array([time for time, _ in ordered], np.int64)
    return Series(times, np.array([values for _, values in ordered], float).reshape(-1, width))


def _of_steps(series: Series, times: NDArray[np.int64]) -> NDArray[np.int64]:
    """Find for every step the first row from its time on and before the next step's, or -1."""
    index = np.searchsorted(series.times, times)
    ends = np.append(times[1:], np.iinfo(np.int64).max)
    there = (index < len(series.times)) & (np.append(series.times, np.iinfo(np.int64).max)[index] < ends)
    return np.where(there, index, -1)
