"""Writing a recording: steps are gathered, encoded together, and on the disk chunk by chunk."""

from __future__ import annotations

import base64
import errno
import logging
import os
import shutil
from collections.abc import Callable, Mapping, Sequence
from contextlib import nullcontext, suppress
from itertools import accumulate
from pathlib import Path
from types import TracebackType
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np
import orjson
from foxglove import Channel, Context, open_mcap
from foxglove.channels import FrameTransformsChannel, SceneUpdateChannel
from foxglove.mcap import MCAPCompression, MCAPWriteOptions
from foxglove.messages import FrameTransforms, SceneUpdate
from numpy.typing import NDArray

from transferkit.errors import NotFiniteError, RecordingError
from transferkit.record.format import ABOUT, EPISODE, SCENE, STEP, TRANSFORMS, as_metadata, schema

if TYPE_CHECKING:
    from transferkit.record.format import Names

logging.getLogger("foxglove").setLevel(logging.CRITICAL)  # it warns of every message that a full disk refuses

FULL = 64 * 1024
"""Free bytes of a disk that took no more: a part of a chunk may not have filled it."""

OPTIONS = MCAPWriteOptions(compression=MCAPCompression.Zstd, compression_threads=0)


class Steps(NamedTuple):
    """Steps of an episode that follow one another, as they were played."""

    observation: NDArray[np.float32]
    """`(n, obs_dim)`."""
    action: NDArray[np.float32]
    """`(n, act_dim)`."""
    reward: Sequence[float]
    """`(n,)`."""
    terms: Sequence[Mapping[str, float]]
    """`(n,)`."""
    state: NDArray[np.float64]
    """MuJoCo's integration state, all that the next step depends on, before each step `(n, size)`."""
    physics: Mapping[str, NDArray[np.float64]]
    """What has names in it: `time` `(n, 1)`, `qpos` and `qvel` before each step, `control` in it."""
    next_observation: NDArray[np.float32]
    """After the last step, `(obs_dim,)`."""
    terminated: bool
    """By the last step."""
    truncated: bool
    """By the last step."""


class Recorder:
    """An MCAP file that is being written."""

    def __init__(self, path: Path, metadata: Mapping[str, str], names: Names, time_step: float) -> None:
        """Open a new file.

        Raises:
            RecordingError: the file exists, or cannot be written.
        """
        self.path, self._names, self._nanoseconds = path, names, round(time_step * 1e9)
        self._context = context = Context()  # channels of this file alone, as long as they are held
        try:
            self._writer = open_mcap(path, context=context, writer_options=OPTIONS)
        except FileExistsError:
            raise RecordingError(f"{path} exists", remedy="choose another {out}") from None
        except OSError as error:
            raise RecordingError(f"cannot write {path}: {error}", remedy="choose an {out} in a folder that exists") from None
        self.steps = self._flushed = 0
        try:
            self._sure(lambda: self._writer.write_metadata(ABOUT, dict(metadata)))
        except RecordingError:
            path.unlink(missing_ok=True)
            raise
        self._steps = Channel(STEP, schema=schema(names), context=context)
        self._scene = SceneUpdateChannel(SCENE, context=context)
        self._transforms = FrameTransformsChannel(TRANSFORMS, context=context)

    def __enter__(self) -> Recorder:
        return self

    def __exit__(self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None) -> None:
        with suppress(RecordingError) if error else nullcontext():
            self._sure(self._writer.close)  # with the summary, by which readers find their way quickly
        if isinstance(error, RecordingError) and not self._flushed:
            self.path.unlink(missing_ok=True)  # it holds nothing, and would be in the way of the next try

    def time(self, step: int) -> int:
        """Return the nanoseconds of a step of this file."""
        return step * self._nanoseconds

    def add_steps(self, episode: int, first: int, steps: Steps, total: float, inner: Mapping[str, NDArray[Any]]) -> float:
        """Write steps of an episode from its step `first` on; returns the return so far, `total` before them.

        `inner` has `core_input`, `core_output` and `value`, or less, each with a row for every step.

        Raises:
            NotFiniteError: NaN or infinity in a step, which JSON cannot hold.
            RecordingError: the disk takes no more.
        """
        _check_finite(episode, first, steps, inner)
        returns = list(accumulate(steps.reward, initial=total))[1:]
        columns = {"return": returns, **self._columns(steps), **self._inner_columns(inner)}
        for k, values in enumerate(zip(*columns.values(), strict=True), first):
            message = {"episode": episode, "step": k, **dict(zip(columns, values, strict=True))}
            if message["terminated"] or message["truncated"]:
                message["next_observation"] = dict(zip(self._names.observation, steps.next_observation, strict=True))
            # float32 values stay so: orjson writes the fewest digits that read back as the same float32.
            self._steps.log(orjson.dumps(message, option=orjson.OPT_SERIALIZE_NUMPY), log_time=self.time(self.steps))
            self.steps += 1
        self._sure(self._writer.flush)  # these steps are the operating system's now, whatever becomes of this process
        self._flushed = self.steps
        return returns[-1]

    def add_scene(self, at: int, message: SceneUpdate) -> None:
        """Write the geoms."""
        self._scene.log(message, log_time=at)

    def add_transforms(self, at: int, message: FrameTransforms) -> None:
        """Write where the bodies are."""
        self._transforms.log(message, log_time=at)

    def end_episode(self, **about: float | bool) -> None:
        """Note an episode that is whole."""
        self._sure(lambda: self._writer.write_metadata(EPISODE, as_metadata(about)))

    def _sure(self, write: Callable[[], None]) -> None:
        try:
            write()
        except RuntimeError as error:
            again = "record again into another {out}" if self._flushed else "record again"
            raise RecordingError(
                f"cannot go on writing {self.path}: {self._reason(error)}", remedy=f"make room on the disk, and {again}"
            ) from None

    def _reason(self, error: RuntimeError) -> str:
        """Name a full disk, of which the library only says that writing failed."""
        full = shutil.disk_usage(self.path.parent).free < FULL
        return os.strerror(errno.ENOSPC) if full else str(error)

    def _columns(self, steps: Steps) -> dict[str, Sequence[Any]]:
        """Make a value of every field for each step."""
        going_on, physics = [False] * (len(steps.reward) - 1), {name: x.tolist() for name, x in steps.physics.items()}
        return {
            "observation": _named(self._names.observation, steps.observation),
            "action": _named(self._names.action, steps.action),
            "reward": steps.reward,
            "reward_terms": steps.terms,
            "terminated": [*going_on, steps.terminated],
            "truncated": [*going_on, steps.truncated],
            "time": [time for (time,) in physics.pop("time")],
            **{name: _named([f"{name}_{i}" for i in range(len(rows[0]))], rows) for name, rows in physics.items()},
            "state": [base64.b64encode(state).decode() for state in steps.state],
        }

    def _inner_columns(self, inner: Mapping[str, NDArray[Any]]) -> dict[str, Sequence[Any]]:
        return {
            name: rows.tolist() if name == "value" else _named(getattr(self._names, name), rows) for name, rows in inner.items()
        }


def _named(names: Sequence[str], rows: Sequence[Any] | NDArray[Any]) -> list[dict[str, Any]]:
    return [dict(zip(names, row, strict=True)) for row in rows]


def _check_finite(episode: int, first: int, steps: Steps, inner: Mapping[str, NDArray[Any]]) -> None:
    following = np.vstack((steps.observation[1:], steps.next_observation))
    numbers = (steps.observation, following, steps.action, np.array(steps.reward)[:, None], *inner.values())
    bad = np.flatnonzero(~np.logical_and.reduce([np.isfinite(x.reshape(len(x), -1)).all(-1) for x in numbers]))
    if len(bad):
        raise NotFiniteError(
            f"step {first + bad[0]} of episode {episode} has a NaN or infinite value; the recording ends before step {first}",
            remedy="find out what the policy or the environment does there, and record into another {out}",
        )
