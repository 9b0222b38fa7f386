"""Reading recordings, whole or damaged; nothing in a file is run."""

from __future__ import annotations

import itertools
from collections import Counter
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import TYPE_CHECKING

import msgspec
import numpy as np
from mcap.records import Channel, Message, Metadata
from numpy.typing import NDArray

from transferkit.errors import RecordingError
from transferkit.reading import FormatError, typed
from transferkit.record.format import ABOUT, EPISODE, STEP, VERSION, About, Ended, Names, Step, from_metadata
from transferkit.record.mcap_file import Damage, records

if TYPE_CHECKING:
    from transferkit.spec import IOSpec

CUT, DAMAGED = "is cut", "is damaged"
SHORT, LACKING = "holds fewer episodes than it was to", "lacks steps of its episodes"


@dataclass(frozen=True)
class Contents:
    """The records of a file as far as they are whole."""

    about: About | None
    """The file's metadata; None for a file of another tool."""
    steps: list[Step]
    """Messages of the topic `/step`."""
    flaw: str = ""
    """Why some are missing; empty for a file that is complete."""


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
        RecordingError: it does not exist, is not an MCAP file, or its metadata or a step has not the form of one.
    """
    about, steps, episodes, flaw, channel = None, [], {}, "", None
    step_of = msgspec.json.Decoder(Step).decode
    try:
        for record in records(path):
            if isinstance(record, Message):
                if record.channel_id == channel:
                    steps.append(step_of(record.data))
            elif isinstance(record, Damage):
                flaw = CUT if record.cut else flaw or DAMAGED
            elif isinstance(record, Channel) and record.topic == STEP:
                channel = record.id
            elif isinstance(record, Metadata) and record.name == ABOUT:
                about = _about(record.metadata, path)
                if about_only:
                    break
            elif isinstance(record, Metadata) and record.name == EPISODE:
                ended = from_metadata(record.metadata, Ended)
                episodes[ended.index] = ended.steps
    except (FormatError, msgspec.MsgspecError, ValueError, RecursionError) as error:
        raise RecordingError(f"{path} is damaged: {error}", remedy="record it again", topic="recordings") from None
    if about is not None and not about_only:
        flaw = flaw or _missing(about, episodes, steps)
    return Contents(about, steps, "" if about_only else flaw)


def _missing(about: About, episodes: Mapping[int, int], steps: Sequence[Step]) -> str:
    """What a file says it holds, and does not: some of its steps were lost when it was recovered from a damaged one."""
    if about.episodes not in (None, len(episodes)):
        return SHORT
    counts = Counter(step.episode for step in steps)
    return "" if all(counts[index] == count for index, count in episodes.items()) else LACKING


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
    last = [not step.precedes(after) for step, after in itertools.pairwise(steps)] + [True] * bool(steps)
    known = np.array([step.ended or not is_last for step, is_last in zip(steps, last, strict=True)], bool)
    if not known.any():
        raise RecordingError(f"{path} holds no whole step", remedy="record it again", topic="recordings")
    observation = _array([step.observation for step in steps], names.observation, path)
    following = np.roll(observation, -1, axis=0)
    ends = [k for k, step in enumerate(steps) if step.ended]
    following[ends] = _array([steps[k].next_observation or {} for k in ends], names.observation, path)
    kept = list(itertools.compress(steps, known))
    transitions = Transitions(
        observation[known],
        _array([step.action for step in kept], names.action, path),
        np.array([step.reward for step in kept], np.float32),
        following[known],
        np.array([step.terminated for step in kept]),
        np.array([step.truncated for step in kept]),
        (_taken(path, contents.flaw, kept),) if contents.flaw else (),
    )
    check_finite(transitions, path)
    if not about_of(contents, path).clip_actions and np.abs(transitions.action).max() > 1:
        raise RecordingError(
            f"{path} has actions beyond -1 to 1 that were not clipped, as under the paper preset",
            remedy="record a run of another preset",
        )
    return replace(transitions, action=transitions.action.clip(-1.0, 1.0))


def _about(metadata: dict[str, str], path: Path) -> About:
    content = from_metadata(metadata, dict)
    if content.get("format") != VERSION:
        raise RecordingError(
            f"{path} has recording format {content.get('format')}, this transferkit reads up to {VERSION}",
            remedy="upgrade transferkit",
        )
    return typed(content, About)


def about_of(contents: Contents, path: Path, remedy: str = "name its channels with {mapping}") -> About:
    """Take what a recording of ours says of itself.

    Raises:
        RecordingError: it is not one of ours, with the remedy.
    """
    if contents.about is None:
        raise RecordingError(f"{path} is not a recording of transferkit", remedy=remedy)
    return contents.about


def spec_of(contents: Contents, path: Path) -> IOSpec:
    """Take the environment's spec from a recording of ours.

    Raises:
        RecordingError: it is not one of ours.
    """
    return about_of(contents, path).spec


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


def _taken(path: Path, flaw: str, steps: Sequence[Step]) -> str:
    part = "" if steps[-1].ended else ", the last one in part"
    return f"{path} {flaw}: {len(steps)} steps of {len({step.episode for step in steps})} episodes are taken{part}"


def _array(rows: Sequence[dict[str, float]], names: Sequence[str], path: Path) -> NDArray[np.float32]:
    try:
        return np.array([[row[name] for name in names] for row in rows], np.float32).reshape(len(rows), len(names))
    except KeyError as error:
        raise RecordingError(f"{path}: a step lacks {error}", remedy="record it again", topic="recordings") from None
