"""Writing a recording: rows are gathered, encoded together, and on the disk chunk by chunk."""

from __future__ import annotations

import base64
import json
from collections.abc import Mapping, Sequence
from pathlib import Path
from types import TracebackType
from typing import Any, NamedTuple

import numpy as np
import orjson
from foxglove_schemas_protobuf.FrameTransforms_pb2 import FrameTransforms
from foxglove_schemas_protobuf.SceneUpdate_pb2 import SceneUpdate
from mcap.well_known import MessageEncoding, SchemaEncoding
from mcap.writer import CompressionType, Writer
from mcap_protobuf.schema import register_schema
from numpy.typing import NDArray

from transferkit.errors import NotFiniteError, RecordingError
from transferkit.record.format import ABOUT, EPISODE, SCENE, STEP, TRANSFORMS, Names, schema

CHUNK = 256 * 1024
"""Bytes before compression; what a kill can lose."""

MOST = 1000
"""Coordinates and controls that have names."""


class Row(NamedTuple):
    """One step, as it was played."""

    observation: NDArray[np.float32]
    action: NDArray[np.float32]
    control: NDArray[np.float64]
    reward: float
    terms: Mapping[str, float]
    terminated: bool
    truncated: bool
    next_observation: NDArray[np.float32]
    time: float
    """Simulated seconds of the episode before the step."""
    qpos: NDArray[np.float64]
    qvel: NDArray[np.float64]
    state: NDArray[np.float64]
    """MuJoCo's integration state before the step: all that the next one depends on."""


class Recorder:
    """An MCAP file that is being written."""

    def __init__(self, path: Path, metadata: Mapping[str, str], names: Names, time_step: float) -> None:
        """Open a new file.

        Raises:
            RecordingError: the file exists, or cannot be written.
        """
        self.path, self._names, self._nanoseconds = path, names, round(time_step * 1e9)
        try:
            self._file = path.open("xb")
        except FileExistsError:
            raise RecordingError(f"{path} exists; pass another --out FILE.mcap") from None
        except OSError as error:
            raise RecordingError(f"cannot write {path}: {error.strerror}; pass --out in a folder that exists") from None
        self._writer = Writer(self._file, chunk_size=CHUNK, compression=CompressionType.ZSTD)
        self._writer.start(profile="", library="transferkit")
        self._writer.add_metadata(ABOUT, dict(metadata))
        self._channels = {STEP: self._json_channel(STEP, names)}
        self._channels |= {topic: self._protobuf_channel(topic, kind) for topic, kind in PROTOBUF.items()}
        self._control, self._qpos, self._qvel = ([f"{name}_{i}" for i in range(MOST)] for name in ("ctrl", "qpos", "qvel"))
        self.steps = 0

    def __enter__(self) -> Recorder:
        return self

    def __exit__(self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None) -> None:
        if error is None:
            self._writer.finish()  # the summary, with which readers find their way quickly
        self._file.close()  # without it the file counts as cut, which it is

    def time(self, step: int) -> int:
        """Nanoseconds of a step of this file."""
        return step * self._nanoseconds

    def add_rows(self, episode: int, first: int, rows: Sequence[Row], total: float, inner: Mapping[str, NDArray[Any]]) -> float:
        """Write steps of an episode from its step `first` on; returns the return so far, `total` before them.

        `inner` has `core_input`, `core_output` and `value`, or less, each with a row for every step.

        Raises:
            NotFiniteError: NaN or infinity in a step, which JSON cannot hold.
        """
        self._check_finite(episode, first, rows)
        values = inner.get("value", ())
        vectors = {name: rows for name, rows in inner.items() if name != "value"}
        for k, row in enumerate(rows):
            total += row.reward
            message = {"episode": episode, "step": first + k, **self._step(row), "return": total}
            for name, found in vectors.items():
                message[name] = dict(zip(getattr(self._names, name), found[k], strict=True))
            if len(values):
                message["value"] = float(values[k])
            # float32 values stay so: orjson writes the fewest digits that read back as the same float32.
            data = orjson.dumps(message, option=orjson.OPT_SERIALIZE_NUMPY)
            at = self.time(self.steps)
            self._writer.add_message(self._channels[STEP], at, data, at)
            self.steps += 1
        self._file.flush()  # whole chunks are the operating system's now, whatever becomes of this process
        return total

    def add_protobuf(self, topic: str, message: SceneUpdate | FrameTransforms, at: int) -> None:
        """Write a scene or transforms."""
        self._writer.add_message(self._channels[topic], at, message.SerializeToString(), at)

    def end_episode(self, **about: float | bool) -> None:
        """Note an episode that is whole."""
        self._writer.add_metadata(EPISODE, {name: json.dumps(value) for name, value in about.items()})

    def _check_finite(self, episode: int, first: int, rows: Sequence[Row]) -> None:
        sums = [row.next_observation.sum(dtype=np.float64) + row.action.sum(dtype=np.float64) + row.reward for row in rows]
        bad = np.flatnonzero(~np.isfinite(sums))
        if len(bad):
            raise NotFiniteError(f"step {first + bad[0]} of episode {episode} has a NaN or infinite value; it is not recorded")

    def _step(self, row: Row) -> dict[str, Any]:
        names = self._names
        ended = row.terminated or row.truncated
        return {
            "observation": dict(zip(names.observation, row.observation, strict=True)),
            "action": dict(zip(names.action, row.action, strict=True)),
            "control": dict(zip(self._control, row.control.tolist(), strict=False)),
            "reward": row.reward,
            "reward_terms": row.terms,
            "terminated": row.terminated,
            "truncated": row.truncated,
            "time": row.time,
            "qpos": dict(zip(self._qpos, row.qpos.tolist(), strict=False)),
            "qvel": dict(zip(self._qvel, row.qvel.tolist(), strict=False)),
            "state": base64.b64encode(row.state.tobytes()).decode(),
        } | ({"next_observation": dict(zip(names.observation, row.next_observation, strict=True))} if ended else {})

    def _json_channel(self, topic: str, names: Names) -> int:
        shape = schema(names)
        identifier = self._writer.register_schema(shape["title"], SchemaEncoding.JSONSchema, json.dumps(shape).encode())
        return self._writer.register_channel(topic, MessageEncoding.JSON, identifier)

    def _protobuf_channel(self, topic: str, kind: type) -> int:
        return self._writer.register_channel(topic, MessageEncoding.Protobuf, register_schema(self._writer, kind))


PROTOBUF = {SCENE: SceneUpdate, TRANSFORMS: FrameTransforms}
