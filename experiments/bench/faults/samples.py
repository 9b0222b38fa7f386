"""A whole sample of every format, made by the program itself, with its readers."""

from __future__ import annotations

import contextlib
import json
import os
import signal
import sys
import zlib
from collections.abc import Sequence
from dataclasses import replace
from functools import partial
from io import BytesIO
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
import torch
import zstandard
from mcap.data_stream import ReadDataStream, RecordBuilder
from mcap.opcode import Opcode
from mcap.records import Chunk
from mcap.writer import CompressionType, Writer

from experiments.bench.faults import mutate
from experiments.bench.faults.formats import (
    Format,
    damage,
    forge_header,
    forge_json,
    forge_state,
    forge_tensors,
    save_tensors,
    sha256,
)
from experiments.matrix.cell import Cell
from experiments.matrix.cell_folder import CELL, SPEED, DamagedError, cell_folders
from experiments.matrix.grid_toml import load_cells
from experiments.matrix.results import collect, read_results
from experiments.matrix.runner import run_cell
from transferkit.cli.zoo import summary
from transferkit.config import TrainConfig, identity, with_settings
from transferkit.envs import derive_spec, id_from_file, make_env
from transferkit.errors import ArtifactError, InterruptedRunError
from transferkit.files import read_json
from transferkit.nn import Architecture, Dynamics, Ensemble, EnsembleArchitecture, Normalizer, PolicyNet
from transferkit.policy.core import Core, stack_members
from transferkit.policy.saved import load_policy
from transferkit.reading import sealed
from transferkit.record.format import ABOUT, EPISODE, STEP, as_metadata, from_metadata
from transferkit.record.mapping import load_mapping, read_mapped
from transferkit.record.mcap_file import MAGIC
from transferkit.record.play import record_episodes
from transferkit.record.reader import read, read_transitions
from transferkit.record.replay import replay_recording
from transferkit.run import CHECKPOINT, POLICY, RECORD, RESULT, EpisodeRow, EvaluationRow, Result, read_record, read_table
from transferkit.streams import Streams
from transferkit.subject import load_subject, load_value
from transferkit.training import run_training
from transferkit.zoo.artifact import ENSEMBLES, check_probe, ensemble_card, load_core, normalizer_card, policy_card, save_core
from transferkit.zoo.card import CARD, PROBE, WEIGHTS, read_card
from transferkit.zoo.catalog import ZOO_PATH, find_core, list_cards
from transferkit.zoo.readme import render

if TYPE_CHECKING:
    from experiments.bench.faults.formats import (
        Random,
    )
    from transferkit.config import Algorithm
    from transferkit.record.reader import Transitions

RELEASED, ENV = "inverted-pendulum-v1", "InvertedPendulum-v5"

GRID = f"""cores = ["{RELEASED}"]
targets = ["{ENV}"]
arms = ["scratch", "constant", "zero-action"]
seeds = "0-3"
members = [0, 1]
steps = 64
eval_every = 32
eval_episodes = 1
[[trainer]]
algo = "ppo"
preset = "default"
name = "small"
set = {{"ppo.epochs" = 1, "network.hidden" = [8]}}
[[trainer]]
algo = "dyna-ddpg"
set = {{"dyna.gamma" = 0.9, "dyna.exploration_noise" = 0.1}}
"""

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

SETTINGS: dict[Algorithm, dict[str, Any]] = {
    "ppo": {"ppo.epochs": 1, "ppo.rollout": "steps", "ppo.rollout_steps": 16, "network.hidden": [8]},
    "dyna-ddpg": {"network.hidden": [8], "model.hidden": [8], "model.members": 2, "dyna.updates_per_step": 1},
    "dyna-ppo": {
        "network.hidden": [8],
        "model.hidden": [8],
        "model.members": 2,
        "model.every": 50,
        "model.updates": 2,
        "dyna_ppo.rollouts": 4,
    },
}
"""The smallest runs."""

CHECKPOINTS = {"ppo": 0.02, "dyna-ddpg": 0.008, "dyna-ppo": 0.003}
"""Their shares: each trains to its end, which takes long."""

IDS = (
    ENV,
    "dm_control/cartpole-balance-v0",
    f"{mutate.PLANTED}:Hopper-v5",
    "a:b:c",
    ":X",
    "..:X",
    "Hopper-v4",
    "dm_control/x-y-v0",
    "Ant-v5 ",
)


def formats(scratch: Path) -> list[Format]:
    """All of them, in folders under `scratch`, which has the planted module too."""
    sys.path.insert(0, str(scratch))
    scratch.mkdir(parents=True)
    (scratch / f"{mutate.PLANTED}.py").write_text("")
    return [
        *_core(scratch / "core" / "small-v1"),
        *_runs(scratch),
        _cells(scratch / "cells"),
        *_recordings(scratch),
        _text(scratch / "grid", "grids", GRID, 0.04, _load_cells),
        _text(scratch / "mapping", "mappings", MAPPING, 0.1, _load_mapping(scratch)),
        _text(scratch / "ids", "environment ids", "\n".join(IDS), 0.02, _make_env),
    ]


def _core(folder: Path) -> list[Format]:
    _write_core(folder)
    return [
        Format("cards", 0.25, folder, _change_card, _read_card),
        Format("weights", 0.12, folder, partial(_change_tensors, WEIGHTS), _load_core, _same_core),
        Format("probes", 0.05, folder, partial(_change_tensors, PROBE), _load_core, _same_core),
    ]


def _write_core(folder: Path) -> None:
    """A small core of two members with all components, under the card of a released one."""
    card = read_card(find_core(RELEASED))
    inputs = card.source.obs_dim + card.source.act_dim
    policy = Architecture(card.source.obs_dim, card.source.act_dim, (6,))
    ensembles = {
        "critic": EnsembleArchitecture(2, inputs, 1, (6,)),
        "dynamics": EnsembleArchitecture(2, inputs, Dynamics.out_dim(card.source.obs_dim), (6,)),
    }
    states = {
        "policy": PolicyNet(policy, Streams(0).torch("policy")).state_dict(),
        "normalizer": Normalizer(card.source.obs_dim).state_dict(),
        **{name: Ensemble(shape, Streams(0).torch(name)).state_dict() for name, shape in ensembles.items()},
    }
    for name in ensembles:
        states[name] = {f"ensemble.{key}": tensor for key, tensor in states[name].items()}
    states["dynamics"] |= {"mean": torch.zeros(inputs), "std": torch.ones(inputs)}
    components = {name: stack_members([state, state]) for name, state in states.items()}
    core = Core(folder.name, card.source, policy, (0, 1), components, ensembles=ensembles)
    cards = {"policy": policy_card(policy), "normalizer": normalizer_card(policy.obs_dim)}
    cards |= {name: ensemble_card(name, ensembles[name]) for name in ENSEMBLES}
    score = replace(card.score, members=card.score.members[:2])
    save_core(core, replace(card, id=core.id, components=cards, seeds=(0, 1), spent=card.spent[:2], score=score), folder)


def _change_card(folder: Path, random: Random) -> bool:
    return (forge_json if random.random() < 0.8 else damage)(folder / CARD, random)


def _change_tensors(name: str, folder: Path, random: Random) -> bool:
    if random.random() < 0.1:
        return damage(folder / name, random)
    blob = (folder / name).read_bytes()
    way = int(random.integers(3))
    if way == 0:
        blob = save_tensors(forge_tensors(_tensors(blob), random))
    else:
        blob = forge_header(blob, random) if way == 1 else mutate.in_bytes(blob, random)
    (folder / name).write_bytes(blob)
    card = json.loads((folder / CARD).read_text())
    card["files"][name] = sha256(blob)
    (folder / CARD).write_text(json.dumps(sealed(card)))
    return True


def _tensors(blob: bytes) -> dict[str, torch.Tensor]:
    import safetensors.torch  # noqa: PLC0415 - beside our own reader, which checks more

    return safetensors.torch.load(blob)


def _read_card(folder: Path, random: Random) -> Any:  # noqa: ANN401 - a card
    if random.random() < 0.1:
        os.environ[ZOO_PATH] = str(folder.parent)
        list_cards()  # never raises
    card = read_card(folder)
    render(card)
    json.dumps([summary(card), card.to_json()], allow_nan=False)
    load_core(folder)
    with contextlib.suppress(ArtifactError):
        TrainConfig.from_json(card.config)
    return card


def _load_core(folder: Path, random: Random) -> Any:  # noqa: ANN401 - a core
    del random
    core = load_core(folder)
    check_probe(core, folder)
    return core


def _same_core(found: Any, whole: Any) -> bool:  # noqa: ANN401 - cores
    return found.digest == whole.digest


def _runs(scratch: Path) -> list[Format]:
    found = []
    for algo, settings in SETTINGS.items():
        config = TrainConfig(ENV, algo=algo, steps=200, eval_episodes=1, eval_every=100)
        config = with_settings(config, settings)
        run_training(config, out=scratch / algo)
        _stop(config, scratch / f"{algo}-stopped")
        stopped = scratch / f"{algo}-stopped"
        found += [
            Format(f"finished runs, {algo}", 0.1, scratch / algo, _change_run, _read_run, _same_run),
            Format(f"checkpoints, {algo}", CHECKPOINTS[algo], stopped, _change_checkpoint, _resume(config), _same_end),
        ]
    return found


def _stop(config: TrainConfig, out: Path) -> None:
    """Leave a run stopped half way, as by Ctrl-C."""
    with contextlib.suppress(InterruptedRunError):
        run_training(config, out=out, report=lambda *_: signal.raise_signal(signal.SIGINT))
    assert (out / CHECKPOINT).exists()


def _change_run(run: Path, random: Random) -> bool:
    name = str(random.choice([RECORD, RECORD, RESULT, POLICY, POLICY, "episodes.csv", "evaluations.csv"]))
    path = run / name
    if random.random() < 0.4:
        return damage(path, random)
    if path.suffix == ".json":
        return forge_json(path, random)
    if path.suffix == ".csv":
        path.write_text(mutate.in_tokens(path.read_text().replace(",", "=", 1), random).replace("=", ","), errors="replace")
        result = json.loads((run / RESULT).read_text())
        result["files"][name] = sha256(path.read_bytes())
        (run / RESULT).write_text(json.dumps(sealed(result)))
        return True
    return forge_state(path, random)


def _read_run(run: Path, random: Random) -> Any:  # noqa: ANN401 - what a run holds
    del random
    record = read_record(run)
    config = TrainConfig.from_json(record)
    policy = load_policy(run)
    load_value(run, policy)
    with torch.no_grad():
        policy(torch.zeros(2, policy.obs_dim))
    tables = [{name: column.tolist() for name, column in read_table(run, kind).items()} for kind in (EpisodeRow, EvaluationRow)]
    return identity(config), read_json(run / RESULT, Result), tables, policy.state_dict()


def _same_run(found: Any, whole: Any) -> bool:  # noqa: ANN401 - what runs hold
    same = all(torch.equal(found[3][name], tensor) for name, tensor in whole[3].items())
    return same and found[:3] == whole[:3]


def _change_checkpoint(run: Path, random: Random) -> bool:
    name = str(random.choice([CHECKPOINT, CHECKPOINT, CHECKPOINT, RECORD]))
    if random.random() < 0.25:
        return damage(run / name, random)
    return forge_state(run / name, random) if name == CHECKPOINT else forge_json(run / name, random)


def _resume(config: TrainConfig) -> Any:  # noqa: ANN401 - a reader
    return lambda run, random: run_training(replace(config), out=run, resume=True)


def _same_end(found: Result, whole: Result) -> bool:
    return replace(found, seconds=0.0, run_dir="") == replace(whole, seconds=0.0, run_dir="")


def _cells(out: Path) -> Format:
    cell = Cell(
        "scratch", "", "small", with_settings(TrainConfig(ENV, steps=64, eval_episodes=1, eval_every=32), SETTINGS["ppo"])
    )
    run_cell(cell, out, "a test")
    return Format("cells", 0.08, out, _change_cell, _collect)


def _change_cell(out: Path, random: Random) -> bool:
    (where,) = cell_folders(out)
    if random.random() < 0.4:
        return _change_run(where / "run", random)
    path = where / str(random.choice([CELL, CELL, SPEED]))
    return (forge_json if random.random() < 0.6 else damage)(path, random)


def _collect(out: Path, random: Random) -> Any:  # noqa: ANN401 - rows
    del random
    results = read_results(out)
    for what in results.damaged.values():
        raise DamagedError(what)
    collect(out)
    return results.rows


def _recordings(scratch: Path) -> list[Format]:
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


def _text(folder: Path, name: str, text: str, share: float, use: Any) -> Format:  # noqa: ANN401 - a reader
    folder.mkdir()
    (folder / "text").write_text(text)

    def change(work: Path, random: Random) -> bool:
        path = work / "text"
        if random.random() < 0.3:
            damage(path, random)
        else:
            path.write_bytes(mutate.in_tokens(path.read_text(), random).encode(errors="surrogatepass"))
        return True  # a text has no checksum

    return Format(name, share, folder, change, use)


def _load_cells(folder: Path, random: Random) -> Sequence[Cell]:
    del random
    cells = load_cells(folder / "text")
    json.dumps([cell.to_json() for cell in cells[:10]], allow_nan=False)
    return cells


def _load_mapping(scratch: Path) -> Any:  # noqa: ANN401 - a reader
    spec = derive_spec(ENV)

    def load(folder: Path, random: Random) -> object:
        del random
        channels = load_mapping(folder / "text")
        return read_mapped(scratch / "foreign" / "a.mcap", channels, spec)

    return load


def _make_env(folder: Path, random: Random) -> object:
    lines = (folder / "text").read_bytes().decode(errors="replace").split("\n")
    changed = [line for line in lines if line not in IDS]
    env_id = changed[int(random.integers(len(changed)))] if len(changed) > 1 else ENV
    return make_env(id_from_file(env_id, "a file")).close()
