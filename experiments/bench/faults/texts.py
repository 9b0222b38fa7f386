"""Grids, mappings and environment ids."""

from __future__ import annotations

import json
from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any

from experiments.bench.faults import mutate
from experiments.bench.faults.formats import (
    ENV,
    RELEASED,
    Format,
    damage,
)
from experiments.bench.faults.recordings import MAPPING
from experiments.matrix.grid_toml import load_cells
from transferkit.envs import derive_spec, id_from_file, make_env
from transferkit.record.mapping import load_mapping, read_mapped

if TYPE_CHECKING:
    from experiments.bench.faults.formats import Random
    from experiments.matrix.cell import Cell

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
    f"{ENV}?frame_skip=4&reset_noise_scale=0.02&vary.mass=[0.7,1.3]&vary.delay=2",
    "Hopper-v5?vary.length.thigh=0.8&vary.drop_observation=[0,1]&vary.noise=0.1",
    "<FlattenObservation of Hopper-v5>",
)


def texts(scratch: Path) -> list[Format]:
    """Three lists of lines."""
    return [
        _text(scratch / "grid", "grids", GRID, 0.04, _load_cells),
        _text(scratch / "mapping", "mappings", MAPPING, 0.1, _load_mapping(scratch)),
        _text(scratch / "ids", "environment ids", "\n".join(IDS), 0.02, _make_env),
    ]


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
