"""Recordings, ours and those of other tools."""

from __future__ import annotations

import json
import zlib
from dataclasses import replace
from io import BytesIO
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
import zstandard
from mcap.data_stream import ReadDataStream, RecordBuilder
from mcap.opcode import Opcode
from mcap.records import Chunk
from mcap.writer import CompressionType, Writer

from experiments.bench.faults import mutate
from experiments.bench.faults.formats import (
    ENV,
    RELEASED,
    Format,
    damage,
)
from transferkit.envs import derive_spec
from transferkit.record.format import ABOUT, EPISODE, STEP, as_metadata, from_metadata
from transferkit.record.mapping import load_mapping, read_mapped
from transferkit.record.mcap_file import MAGIC
from transferkit.record.play import record_episodes
from transferkit.record.reader import read, read_transitions
from transferkit.record.replay import replay_recording
from transferkit.subject import load_subject

if TYPE_CHECKING:
    from experiments.bench.faults.formats import Random
    from transferkit.record.reader import Transitions

MAPPING = """[observation]
topic = "/state"
fields = ["position.0", "position.1", "velocity.0", "velocity.1"]
[action]
topic = "/command"
fields = ["x"]
[reward]
topic = "/reward"
field = "value"
[terminated]
topic = "/reward"
field = "done"
"""


def recordings(scratch: Path) -> list[Format]:
    """A recording of ours, and one of another tool with its mapping."""
    ours, theirs = scratch / "recording", scratch / "foreign"
    ours.mkdir(), theirs.mkdir()
    subject = replace(load_subject(RELEASED), max_episode_steps=12)
    record_episodes(subject, ours / "a.mcap", episodes=2)
    _write_foreign(theirs / "a.mcap")
    (scratch / "mapping.toml").write_text(MAPPING)
    spec, channels = derive_spec(ENV), load_mapping(scratch / "mapping.toml")
    return [
        Format("recordings", 0.1, ours, _change_recording, lambda folder, random: _transitions(folder, random, spec), _part),
        Format(
            "others' recordings",
            0.05,
            theirs,
            _change_foreign,
            lambda folder, random: (read_mapped(folder / "a.mcap", channels, spec),),
            lambda found, whole: True,  # other tools' files have no checksum of everything
        ),
    ]


def _transitions(folder: Path, random: Random, spec: Any) -> Any:  # noqa: ANN401 - transitions
    path = folder / "a.mcap"
    if random.random() < 0.1:
        replay_recording(path)
    return read_transitions(path, spec), read(path).flaw


def _part(found: tuple[Transitions, str], whole: tuple[Transitions, str]) -> bool:
    """All steps; or some, and it is said that others are missing."""
    rows, known = _rows(found[0]), _rows(whole[0])
    return rows == known if not found[1] else set(rows) <= set(known)


def _rows(transitions: Transitions) -> list[bytes]:
    columns = [np.asarray(column, np.float32).reshape(len(transitions), -1) for column in transitions.batch()]
    return [row.tobytes() for row in np.concatenate(columns, axis=1)]


def _change_recording(folder: Path, random: Random) -> bool:
    path = folder / "a.mcap"
    ways = (damage, _rewrite, _forge_chunk)
    return ways[int(random.choice(3, p=[0.5, 0.35, 0.15]))](path, random)


def _forge_chunk(path: Path, random: Random) -> bool:
    """Change bytes in a chunk, or what it declares, with a right checksum; the file's own is left out."""
    data = path.read_bytes()
    at = data.index(bytes([Opcode.CHUNK]), len(MAGIC) + 9 + int.from_bytes(data[len(MAGIC) + 1 : len(MAGIC) + 9], "little"))
    end = at + 9 + int.from_bytes(data[at + 1 : at + 9], "little")
    try:
        chunk = Chunk.read(ReadDataStream(BytesIO(data[at + 9 : end])))
        inner = zstandard.decompress(chunk.data, chunk.uncompressed_size)
    except Exception:  # the byte before was no chunk's
        return damage(path, random)
    inner, declared = mutate.in_bytes(inner, random), None
    if random.random() < 0.3:
        declared = int(random.choice([0, 1, len(inner) - 1, 2**31, 2**33, 2**63]))
    builder, content = RecordBuilder(), zstandard.compress(inner)
    size = len(inner) if declared is None else declared
    Chunk("zstd", content, 0, 10, zlib.crc32(inner), size).write(builder)
    path.write_bytes(data[:at] + builder.end() + data[end:])
    return True


def _rewrite(path: Path, random: Random) -> bool:
    """Forge a message, or what the metadata say, and write the file anew."""
    messages, metadata = _contents(path)
    if random.random() < 0.5:
        at = int(random.integers(len(messages)))
        changed = mutate.in_json(messages[at], random)
        blobs = [mutate.as_text(changed if k == at else message, random) for k, message in enumerate(messages)]
    else:
        blobs = [json.dumps(message).encode() for message in messages]
        name, content = metadata[int(random.integers(len(metadata)))]
        forged = mutate.in_json(content, random)
        metadata = [(own, forged if own == name else other) for own, other in metadata]
    with path.open("wb") as file:
        writer = Writer(file, compression=[*CompressionType][int(random.integers(len(CompressionType)))], chunk_size=20_000)
        writer.start()
        channel = writer.register_channel(STEP, "json", writer.register_schema("step", "jsonschema", b"{}"))
        for name, content in metadata:
            writer.add_metadata(name, _as_metadata(content))
        for k, blob in enumerate(blobs):
            writer.add_message(channel, k, blob, k)
        writer.finish()
    return True


def _contents(path: Path) -> tuple[list[Any], list[tuple[str, dict[str, Any]]]]:
    from mcap.reader import make_reader  # noqa: PLC0415 - the reference reader, beside ours

    with path.open("rb") as file:
        reader = make_reader(file)
        metadata = [(m.name, from_metadata(m.metadata, dict)) for m in reader.iter_metadata() if m.name in (ABOUT, EPISODE)]
        return [json.loads(message.data) for _, _, message in reader.iter_messages([STEP])], metadata


def _as_metadata(content: Any) -> dict[str, str]:  # noqa: ANN401 - JSON
    if not isinstance(content, dict):
        return {"format": "1"}
    try:
        return as_metadata(content)
    except (ValueError, TypeError):
        texts = {name: json.dumps(value) for name, value in content.items()}
        return {name.encode(errors="replace").decode(): text for name, text in texts.items()}


def _write_foreign(path: Path, random: Random | None = None) -> None:
    """Six steps of another tool; with a generator one message is forged, or what describes it."""
    forged, described = (-1, False) if random is None else (int(random.integers(18)), random.random() < 0.3)
    encodings = ("json", "json", "protobuf", "ros1", "\ud800x".encode(errors="replace").decode())
    encoding = encodings[0 if random is None or not described else int(random.integers(len(encodings)))]
    schema = b"{}" if random is None or not described else bytes(random.integers(0, 256, 20, np.uint8))
    with path.open("wb") as file:
        writer = Writer(file)
        writer.start()
        plain = writer.register_schema("any", "protobuf" if described else "jsonschema", schema)
        topics = {name: writer.register_channel(f"/{name}", encoding, plain) for name in ("state", "reward", "command")}
        for k in range(6):
            messages = {
                "state": {"position": [k, 10 + k], "velocity": [20 + k, 30 + k]},
                "command": {"x": k / 10},
                "reward": {"value": 7.0, "done": k == 3},
            }
            for j, (name, message) in enumerate(messages.items()):
                blob = json.dumps(message).encode()
                if random is not None and forged == 3 * k + j:
                    blob = mutate.as_text(mutate.in_json(message, random), random)
                writer.add_message(topics[name], 100 * k, blob, 100 * k)
        writer.finish()


def _change_foreign(folder: Path, random: Random) -> bool:
    if random.random() < 0.5:
        return damage(folder / "a.mcap", random)
    _write_foreign(folder / "a.mcap", random)
    return True
