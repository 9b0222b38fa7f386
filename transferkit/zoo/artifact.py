"""Writing and loading core artifacts. Loading reads safetensors and JSON only, so it never runs code."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING

import safetensors
import safetensors.torch
import torch
from torch import Tensor

from transferkit.errors import ArtifactError
from transferkit.files import write_atomically, write_json
from transferkit.nn import Architecture, EnsembleArchitecture
from transferkit.policy.core import Core
from transferkit.streams import Streams
from transferkit.zoo.card import CARD, PROBE, README, RESTORE, WEIGHTS, ComponentCard, read_card, sha256
from transferkit.zoo.catalog import find_core
from transferkit.zoo.readme import render

if TYPE_CHECKING:
    from transferkit.zoo.card import Card

ENSEMBLES = ("critic", "dynamics")
"""Optional components of a core, each a method of `Core`."""

PROBE_INPUTS = 32
PROBE_TOLERANCE = 1e-5
"""Between machines; matrix products differ in the last bits."""


def load_core(name: str | Path) -> Core:
    """Load a core by id or folder, after its hashes, schema and shapes are checked.

    Raises:
        UnknownNameError: there is no such core.
        ArtifactError: it is damaged, tampered with, or newer than this transferkit.
    """
    folder = find_core(name)
    card = read_card(folder)
    check_hashes(folder, card)
    tensors = _read(folder / WEIGHTS)
    components: dict[str, dict[str, Tensor]] = {}
    for key, tensor in tensors.items():
        component, _, parameter = key.partition("/")
        components.setdefault(component, {})[parameter] = tensor
    if set(components) != set(card.components):
        raise ArtifactError(
            f"core {card.id} holds the components {sorted(components)}, its card says {sorted(card.components)}", remedy=RESTORE
        )
    if "policy" not in components:
        raise ArtifactError(f"core {card.id} has no policy", remedy="pretrain it again")
    try:
        core = _core(card, components)
        for member in range(len(card.seeds)):
            core.policy(member)
            for component in core.ensembles:
                getattr(core, component)(member)
    except (KeyError, TypeError, RuntimeError) as error:  # torch's message lists every tensor that does not fit, on many lines
        reason = " ".join(str(error).split())[:200]
        raise ArtifactError(f"core {card.id}: its weights do not fit its card ({reason})") from None
    return core


def save_core(core: Core, card: Card, folder: Path) -> Card:
    """Write an artifact into a new folder; returns the card with its hashes.

    Raises:
        ArtifactError: the folder exists; a released version is never rewritten.
    """
    if folder.exists() and any(folder.iterdir()):
        raise ArtifactError(f"{folder} exists and a released core is never rewritten", remedy="choose a higher {version}")
    folder.mkdir(parents=True, exist_ok=True)
    flat = {f"{component}/{name}": tensor for component, tensors in core.components.items() for name, tensor in tensors.items()}
    write_atomically(folder / WEIGHTS, safetensors.torch.save(flat))
    write_atomically(folder / PROBE, safetensors.torch.save(_make_probe(core)))
    complete = replace(card, files={name: sha256(folder / name) for name in (WEIGHTS, PROBE)})
    write_json(folder / CARD, complete.to_json())
    write_atomically(folder / README, render(complete).encode())
    return complete


def _core(card: Card, components: dict[str, dict[str, Tensor]]) -> Core:
    kinds = card.components
    ensembles = {name: EnsembleArchitecture.from_json(kinds[name].architecture) for name in ENSEMBLES if name in components}
    architecture = Architecture.from_json(kinds["policy"].architecture)
    return Core(card.id, card.source, architecture, card.seeds, components, str(card.to_json()["digest"]), ensembles)


def policy_card(architecture: Architecture) -> ComponentCard:
    """Make the card's entry of a policy network, with its ends named."""
    heads = ("mean_head", "log_std_head") if architecture.std == "head" else ("mean_head",)
    output = [f"{head}.{name}" for head in heads for name in ("weight", "bias")]
    if architecture.std == "parameter":
        output.append("log_std")
    return ComponentCard("policy", architecture.to_json(), ("body.0.weight",), tuple(output))


def ensemble_card(kind: str, architecture: EnsembleArchitecture) -> ComponentCard:
    """Make the card's entry of critics or of a model, with its ends named."""
    outputs = ("ensemble.head.weight", "ensemble.head.bias")
    statistics = ("mean", "std") if kind == "dynamics" else ()
    return ComponentCard(kind, architecture.to_json(), ("ensemble.body.0.weight",), outputs + statistics)


def normalizer_card(obs_dim: int) -> ComponentCard:
    """Make the card's entry of the source's observation statistics, which are an end as a whole."""
    return ComponentCard("normalizer", {"obs_dim": obs_dim}, ("mean", "var", "count"), ())


def check_hashes(folder: Path, card: Card) -> None:
    """Compare every file with the card.

    Raises:
        ArtifactError: a file is missing or differs.
    """
    for name, expected in card.files.items():
        path = folder / name
        if not path.exists():
            raise ArtifactError(f"core {card.id} lacks its file {name}", remedy=RESTORE)
        if sha256(path) != expected:
            raise ArtifactError(f"core {card.id}: {name} is truncated or was changed", remedy=RESTORE)


def check_probe(core: Core, folder: Path) -> float:
    """Find the largest difference between the core's outputs on the stored inputs and the stored outputs.

    Raises:
        ArtifactError: it exceeds the tolerance.
    """
    stored = _read(folder / PROBE)
    worst = 0.0
    for member in range(len(core.seeds)):
        for name, output in _outputs(core, member, stored["input"]).items():
            worst = max(worst, float((output - stored[name][member]).abs().max()))
    if not worst <= PROBE_TOLERANCE:
        raise ArtifactError(
            f"core {core.id} computes other outputs than it was released with (difference {worst:.2e}, allowed "
            f"{PROBE_TOLERANCE:.0e})",
            remedy="check the version of torch",
            topic="installation",
        )
    return worst


@torch.no_grad()
def _make_probe(core: Core) -> dict[str, Tensor]:
    generator = Streams(0).torch("probe")
    observation = torch.randn(PROBE_INPUTS, core.spec.obs_dim, generator=generator)
    outputs = [_outputs(core, member, observation) for member in range(len(core.seeds))]
    stacked = {name: torch.stack([output[name] for output in outputs]).contiguous() for name in outputs[0]}
    return {"input": observation, **stacked}


@torch.no_grad()
def _outputs(core: Core, member: int, observation: Tensor) -> dict[str, Tensor]:
    """Compute what every component of a member says; critics and model for the policy's own action."""
    mean, log_std = core.policy(member)(observation)
    outputs = {"mean": mean, "log_std": log_std}
    action = mean.clamp(-1.0, 1.0)
    if "critic" in core.ensembles:
        outputs["value"] = core.critic(member)(observation, action)
    if "dynamics" in core.ensembles:
        outputs["next_observation"] = core.dynamics(member).predict(observation, action).next_observation
    return outputs


def _read(path: Path) -> dict[str, Tensor]:
    try:
        return safetensors.torch.load_file(path)
    except (OSError, safetensors.SafetensorError) as error:
        raise ArtifactError(f"{path} cannot be read ({error})", remedy=RESTORE) from None
