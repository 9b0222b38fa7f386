"""Reading recordings, whole or cut; nothing in a file is run."""

from __future__ import annotations

import struct
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any

import numpy as np
import orjson
from mcap.exceptions import McapError
from mcap.records import Channel, Chunk, Footer, Message, Metadata
from mcap.stream_reader import StreamReader, breakup_chunk
from numpy.typing import NDArray

from transferkit.errors import RecordingError
from transferkit.record.format import ABOUT, EPISODE, STEP, VERSION, Names, parse
from transferkit.spec import IOSpec

MAGIC = b"\x89MCAP0\r\n"

CUT_ERRORS = (McapError, struct.error, ValueError, EOFError, IndexError)
"""What the reader raises if a file ends in the middle."""


@dataclass(frozen=True)
class Contents:
    """The records of a file as far as they are whole."""

    about: dict[str, Any]
    """The file's metadata; empty for a file of another tool."""
    episodes: list[dict[str, Any]]
    """Metadata of the episodes that ended."""
    steps: list[dict[str, Any]]
    """Messages of the topic `/step`."""
    complete: bool
    """False for a file that was cut, or that holds fewer whole episodes than it was to."""


@dataclass(frozen=True)
class Transitions:
    """Steps in the order of time; episodes are whole but for the last of a cut file."""

    observation: NDArray[np.float32]
    """`(N, obs_dim)`."""
    action: NDArray[np.float32]
    """`(N, act_dim)`."""
    reward: NDArray[np.float32]
    """`(N,)`."""
    next_observation: NDArray[np.float32]
    """`(N, obs_dim)`."""
    terminated: NDArray[np.bool_]
    """`(N,)`."""
    truncated: NDArray[np.bool_]
    """`(N,)`."""
    notes: Sequence[str] = field(default=())
    """What was left out and why, a sentence each."""

    def __len__(self) -> int:
        return len(self.reward)

    def batch(self) -> tuple[NDArray[np.float32], ...]:
        """Return observation, action, reward, next observation, terminated, as a replay buffer holds them."""
        return self.observation, self.action, self.reward, self.next_observation, self.terminated.astype(np.float32)


def read(path: Path, *, about_only: bool = False) -> Contents:
    """Read every whole chunk of a recording, or, if that is enough, what its metadata says before the first.

    Raises:
        RecordingError: it does not exist, or is not an MCAP file.
    """
    about: dict[str, Any] = {}
    episodes: list[dict[str, Any]] = []
    steps: list[dict[str, Any]] = []
    channel = None
    complete = False
    try:
        for record in records(path):
            if isinstance(record, Message):
                if record.channel_id == channel:
                    steps.append(orjson.loads(record.data))
            elif isinstance(record, Metadata) and record.name == ABOUT:
                about = parse(record.metadata)
                if about_only:
                    break
            elif isinstance(record, Metadata) and record.name == EPISODE:
                episodes.append(parse(record.metadata))
            elif isinstance(record, Channel) and record.topic == STEP:
                channel = record.id
            complete = isinstance(record, Footer)
    except CutError:
        complete = False
    return Contents(about, episodes, steps, complete and len(episodes) == about.get("episodes", len(episodes)))


class CutError(Exception):
    """The file ends in the middle of a record."""


def records(path: Path) -> Iterator[Any]:
    """Yield every record of every whole chunk, in order; raise `CutError` at the end of a file that was cut.

    Raises:
        RecordingError: it does not exist, or is not an MCAP file.
    """
    try:
        file = path.open("rb")
    except OSError as error:
        raise RecordingError(f"cannot read {path}: {error.strerror}", topic="recordings") from None
    with file:
        if file.read(len(MAGIC)) != MAGIC:
            raise RecordingError(f"{path} is not an MCAP file", topic="recordings")
        file.seek(0)
        try:
            for record in StreamReader(file, emit_chunks=True).records:
                yield from breakup_chunk(record, validate_crc=True) if isinstance(record, Chunk) else (record,)
        except CUT_ERRORS as error:
            raise CutError from error
        except Exception as error:  # the decompressors have errors of their own
            if "zstd" in type(error).__module__.lower() or "lz4" in type(error).__module__.lower():
                raise CutError from error
            raise


def read_transitions(path: str | Path, spec: IOSpec) -> Transitions:
    """Read the steps of one of our recordings, for an environment that must be the one it was made in.

    Raises:
        RecordingError: another tool's file, another environment or version of it, no steps, or NaN.
    """
    path = Path(path)
    contents = read(path)
    recorded = spec_of(contents, path)
    check_spec(recorded, spec, path)
    names, steps = Names.of(recorded), contents.steps
    kept = steps if not steps or _ended(steps[-1]) else steps[:-1]  # what the last one led to is not known
    if not kept:
        raise RecordingError(f"{path} holds no whole step", remedy="record it again", topic="recordings")
    observation = _array(steps, "observation", names.observation)
    following = np.empty_like(observation)
    following[:-1] = observation[1:]
    for k, step in enumerate(steps):
        if _ended(step):
            following[k] = [step["next_observation"][name] for name in names.observation]
    n = len(kept)
    transitions = Transitions(
        observation[:n],
        _array(kept, "action", names.action),
        np.array([step["reward"] for step in kept], np.float32),
        following[:n],
        np.array([step["terminated"] for step in kept]),
        np.array([step["truncated"] for step in kept]),
        () if contents.complete else (_taken(path, kept),),
    )
    check_finite(transitions, path)
    if not contents.about["clip_actions"] and np.abs(transitions.action).max() > 1:
        raise RecordingError(
            f"{path} has actions beyond -1 to 1 that were not clipped, as under the paper preset",
            remedy="record a run of another preset",
        )
    return replace(transitions, action=transitions.action.clip(-1.0, 1.0))


def spec_of(contents: Contents, path: Path) -> IOSpec:
    """Take the environment's spec from a recording of ours.

    Raises:
        RecordingError: it has none, or is of a newer format.
    """
    if not contents.about:
        raise RecordingError(f"{path} is not a recording of transferkit", remedy="name its channels with {mapping}")
    if int(contents.about["format"]) > int(VERSION):
        raise RecordingError(
            f"{path} has recording format {contents.about['format']}, this transferkit reads up to {VERSION}",
            remedy="upgrade transferkit",
        )
    return IOSpec.from_json(contents.about["spec"])


def check_spec(recorded: IOSpec, spec: IOSpec, path: Path) -> None:
    """Refuse a recording of another environment, or of one whose numbers mean something else.

    Raises:
        RecordingError: environment, dimensions or names differ.
    """
    if recorded.env_id != spec.env_id:
        raise RecordingError(
            f"{path} was recorded in {recorded.env_id}, not in {spec.env_id}", remedy=f"use {{env={recorded.env_id}}}"
        )
    for what, ours, theirs in (
        ("observation", spec.observation, recorded.observation),
        ("action", spec.action, recorded.action),
    ):
        mine, other = [element.name for element in ours], [element.name for element in theirs]
        if mine != other:
            raise RecordingError(
                f"{path} has {len(other)} {what} elements ({', '.join(other[:4])}, ...), {spec.env_id} has {len(mine)} "
                f"({', '.join(mine[:4])}, ...)",
                remedy="record it again with this version of the environment",
            )


def check_finite(transitions: Transitions, path: Path) -> None:
    """Refuse NaN and infinity.

    Raises:
        RecordingError: there is one.
    """
    for name in ("observation", "action", "reward", "next_observation"):
        values = getattr(transitions, name)
        bad = ~np.isfinite(values.reshape(len(values), -1)).all(axis=1)
        if bad.any():
            raise RecordingError(
                f"{path} has NaN or infinity in {name}, first in step {int(bad.argmax())}", remedy="cut that part out"
            )


def _taken(path: Path, steps: Sequence[dict[str, Any]]) -> str:
    part = "" if _ended(steps[-1]) else ", the last one in part"
    return f"{path} is cut: {len(steps)} steps of {steps[-1]['episode'] + 1} episodes are taken{part}"


def _ended(step: dict[str, Any]) -> bool:
    return step["terminated"] or step["truncated"]


def _array(steps: Sequence[dict[str, Any]], field_name: str, names: Sequence[str]) -> NDArray[np.float32]:
    try:
        return np.array([[step[field_name][name] for name in names] for step in steps], np.float32)
    except KeyError as error:
        raise RecordingError(f"a step lacks {field_name} {error}", remedy="record it again", topic="recordings") from None
