"""Cores: cards, weights and probes."""

from __future__ import annotations

import contextlib
import json
import os
from dataclasses import asdict, replace
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Any

import torch

from experiments.bench.faults import mutate
from experiments.bench.faults.formats import (
    RELEASED,
    Format,
    damage,
    forge_header,
    forge_json,
    forge_tensors,
    save_tensors,
    sha256,
)
from transferkit.config import TrainConfig
from transferkit.errors import ArtifactError
from transferkit.nn import Architecture, Dynamics, Ensemble, EnsembleArchitecture, Normalizer, PolicyNet
from transferkit.policy.core import Core, stack_members
from transferkit.reading import sealed
from transferkit.streams import Streams
from transferkit.zoo.artifact import ENSEMBLES, check_probe, ensemble_card, load_core, normalizer_card, policy_card, save_core
from transferkit.zoo.card import CARD, PROBE, WEIGHTS, read_card
from transferkit.zoo.catalog import ZOO_PATH, find_core, list_cards
from transferkit.zoo.readme import render
from transferkit.zoo.summary import Summary

if TYPE_CHECKING:
    from experiments.bench.faults.formats import Random


def cores(folder: Path) -> list[Format]:
    """A core, of which one file is changed."""
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
    json.dumps([asdict(Summary.of(card)), card.to_json()], allow_nan=False)
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
