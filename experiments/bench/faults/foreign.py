"""Files of other libraries: policies, statistics and descriptors. They have no checksums, so that every mutant is forged."""

from __future__ import annotations

import io
import itertools
import zipfile
from collections.abc import Callable
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING

import msgspec
import numpy as np
import torch
from torch import nn

from experiments.bench.faults import mutate
from experiments.bench.faults.formats import ENV, RELEASED, Format
from transferkit.descriptors import compare, read_descriptor
from transferkit.envs import derive_spec
from transferkit.export import export_descriptor, export_leapp, export_onnx
from transferkit.interop import Given, read_core
from transferkit.subject import load_subject

if TYPE_CHECKING:
    from experiments.bench.faults.formats import Random

POLICIES: dict[str, Given] = {
    "m.zip": Given(stats="none"),
    "m.cleanrl_model": Given(stats="none"),
    "m.pt": Given(activation="elu", action_scale=1.0),
    "m.msgpack": Given(activation="relu", stats="none"),
    "m.onnx": Given(action_scale=1.0),
}
"""Samples of policies, and what their files do not say."""


def foreign(scratch: Path) -> list[Format]:
    """Policies of every library, statistics, and both kinds of descriptors."""
    folders = {name: scratch / name.replace(".", "_") for name in (*POLICIES, "stats.npz", "leapp.yaml", "io.yaml")}
    for folder in folders.values():
        folder.mkdir(parents=True)
    subject = load_subject(RELEASED, values=False)
    _stable_baselines3(folders["m.zip"] / "m.zip")
    torch.save(_cleanrl(), folders["m.cleanrl_model"] / "m.cleanrl_model")
    torch.save({"actor_state_dict": _rsl_rl(), "iter": 1, "infos": None}, folders["m.pt"] / "m.pt")
    (folders["m.msgpack"] / "m.msgpack").write_bytes(_flax())
    export_onnx(subject, folders["m.onnx"] / "m.onnx")
    torch.save(_cleanrl(), folders["stats.npz"] / "m.cleanrl_model")
    np.savez(folders["stats.npz"] / "stats.npz", mean=np.zeros(4), var=np.ones(4))
    export_leapp(subject, folders["leapp.yaml"] / "leapp.yaml")
    export_descriptor(subject, folders["io.yaml"] / "io.yaml")
    policies = [
        Format(f"{name} of others", 0.03, folders[name], partial(_damage, name), partial(_policy, name, given))
        for name, given in POLICIES.items()
    ]
    beside = Format("statistics of others", 0.02, folders["stats.npz"], partial(_damage, "stats.npz"), _statistics)
    described = [
        Format(f"{name} of others", 0.02, folders[name], partial(_damage, name), partial(_descriptor, name))
        for name in ("leapp.yaml", "io.yaml")
    ]
    return [*policies, beside, *described]


def _damage(name: str, folder: Path, random: Random) -> bool:
    """Change bytes of a file, or of a member of a zip."""
    path = folder / name
    data = path.read_bytes()
    inner = data[:2] == b"PK" and random.random() < 0.8
    path.write_bytes(_in_member(data, random) if inner else mutate.in_bytes(data, random))
    return True


def _in_member(data: bytes, random: Random) -> bytes:
    with zipfile.ZipFile(io.BytesIO(data)) as archive:
        members = {name: archive.read(name) for name in archive.namelist()}
    chosen = str(random.choice(sorted(members)))
    members[chosen] = mutate.in_bytes(members[chosen], random)
    buffer = io.BytesIO()
    with zipfile.ZipFile(buffer, "w") as archive:
        for name, content in members.items():
            archive.writestr(name, content)
    return buffer.getvalue()


def _policy(name: str, given: Given, folder: Path, random: Random) -> np.ndarray:
    """What the policy does."""
    del random
    core, *_ = read_core(folder / name, derive_spec(ENV), given, "x")
    return core.policy().act(np.zeros((2, 4), np.float32))


def _statistics(folder: Path, random: Random) -> np.ndarray:
    return _policy("m.cleanrl_model", Given(stats=folder / "stats.npz"), folder, random)


def _descriptor(name: str, folder: Path, random: Random) -> list[str]:
    """What it says beside the physics."""
    del random
    return [row.verdict for row in compare(read_descriptor(folder / name), derive_spec(ENV))]


def _stable_baselines3(path: Path) -> None:
    from stable_baselines3 import SAC  # noqa: PLC0415 - of the dev extra

    SAC("MlpPolicy", ENV, device="cpu", seed=0, policy_kwargs={"net_arch": [8]}, buffer_size=10).save(path)


def _layers(widths: tuple[int, ...], activation: Callable[[], nn.Module]) -> nn.Sequential:
    parts = [(nn.Linear(a, b), activation()) for a, b in itertools.pairwise(widths)]
    return nn.Sequential(*[module for pair in parts for module in pair][:-1])


def _cleanrl() -> dict[str, torch.Tensor]:
    parts = {"actor_mean": _layers((4, 64, 64, 1), nn.Tanh), "critic": _layers((4, 64, 64, 1), nn.Tanh)}
    state = {f"{name}.{key}": value for name, part in parts.items() for key, value in part.state_dict().items()}
    return state | {"actor_logstd": torch.zeros(1, 1)}


def _rsl_rl() -> dict[str, torch.Tensor]:
    """An actor of version 5 with statistics."""
    state = {f"mlp.{key}": value for key, value in _layers((4, 8, 8, 1), nn.ELU).state_dict().items()}
    statistics = {"_mean": torch.zeros(1, 4), "_var": torch.ones(1, 4), "_std": torch.ones(1, 4), "count": torch.tensor(9)}
    return (
        state
        | {f"obs_normalizer.{key}": value for key, value in statistics.items()}
        | {"distribution.std_param": torch.ones(1)}
    )


def _flax() -> bytes:
    dense = [{"kernel": np.ones((n, m), np.float32), "bias": np.ones(m, np.float32)} for n, m in ((4, 3), (3, 1))]
    return msgspec.msgpack.encode({"actor": {"params": {f"Dense_{k}": one for k, one in enumerate(dense)}}}, enc_hook=_packed)


def _packed(array: np.ndarray) -> msgspec.msgpack.Ext:
    return msgspec.msgpack.Ext(1, msgspec.msgpack.encode((array.shape, array.dtype.name, array.tobytes())))
