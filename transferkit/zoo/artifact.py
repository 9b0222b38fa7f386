"""Writing and loading core artifacts. Loading reads safetensors and JSON only, so it never runs code."""

from __future__ import annotations

import hashlib
import os
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING

import safetensors.torch
import torch
from torch import Tensor

from transferkit.config.checks import check_kind
from transferkit.errors import ArtifactError, reason_of
from transferkit.files import write_atomically, write_json
from transferkit.nn import Architecture, Dynamics, EnsembleArchitecture
from transferkit.policy.core import Core
from transferkit.reading import FormatError, read_bytes, typed
from transferkit.run import named_run
from transferkit.streams import Streams
from transferkit.tensors import check_enough, parse_tensors
from transferkit.zoo.card import CARD, LARGEST, PROBE, README, RESTORE, WEIGHTS, ComponentCard, read_card
from transferkit.zoo.catalog import core_folders, find_card, find_core
from transferkit.zoo.on_the_fly import imported
from transferkit.zoo.readme import render
from transferkit.zoo.run_core import core_of_run

if TYPE_CHECKING:
    from transferkit.zoo.card import Card

ENSEMBLES = ("critic", "dynamics")
"""Optional components of a core, each a method of `Core`."""

PROBE_INPUTS = 32
PROBE_TOLERANCE = 1e-5
"""Between machines; matrix products differ in the last bits."""


def load_core(name: str | Path, *, env: str | None = None) -> Core:
    """Load a core by id or folder, after its hashes, schema, shapes and numbers are checked, or take a finished run as one.

    A file of another library is imported as `import_core` does, if it says all that is needed.

    Args:
        name: an id, the folder of a core, the directory of a finished run, the file in it of its best policy, or a file of
            another library.
        env: an environment of yours, such as `module:MyEnv-v0`; only what you name may import a module for a run's record.
            Of a file, the environment that its policy was trained in.

    Raises:
        UnknownNameError: there is no such core.
        ArtifactError: it is damaged, tampered with, or newer than this transferkit.
        ConfigError: a file of another library does not say something.
        DimensionError: a file of another library does not fit the environment.
        RunDirectoryError: a run that is unfinished, damaged, or cannot be a core.
    """
    check_kind("name", name, (str, Path), "give a core's id or its folder")
    check_kind("env", env or "", str, "name the environment, such as 'module:MyEnv-v0'")
    own = Path(name)
    if str(name) not in core_folders() and not os.path.exists(own / CARD):
        if (run := named_run(own)) is not None:
            return core_of_run(run[0], env, best=run[1])
        if os.path.isfile(own):
            return imported(own, env)
        if os.path.isdir(own):
            raise ArtifactError(f"{name} is neither a core's folder nor the directory of a run", topic="cores")
    folder, card = find_core(name), find_card(name)
    check_files(card)
    _read_bytes(folder, PROBE, card)
    components: dict[str, dict[str, Tensor]] = {}
    for key, tensor in _read(folder, WEIGHTS, card).items():
        component, _, parameter = key.partition("/")
        components.setdefault(component, {})[parameter] = tensor
    if set(components) != set(card.components):
        raise ArtifactError(
            f"core {card.id} holds the components {sorted(components)}, its card says {sorted(card.components)}", remedy=RESTORE
        )
    try:
        core = _core(card, components)
        for member in range(len(card.seeds)):
            core.policy(member)
            for component in core.ensembles:
                getattr(core, component)(member)
    except (FormatError, LookupError, TypeError, RuntimeError) as error:  # torch's message lists every tensor on many lines
        raise ArtifactError(f"core {card.id}: its weights do not fit its card ({reason_of(error)})", remedy=RESTORE) from None
    return core


def check_unreleased(folder: Path) -> None:
    """Check that a version is new.

    Raises:
        ArtifactError: its folder has something in it.
    """
    if folder.exists() and any(folder.iterdir()):
        raise ArtifactError(f"{folder} exists and a released core is never rewritten", remedy="choose a higher {version}")


def save_core(core: Core, card: Card, folder: Path) -> Card:
    """Write an artifact into a new folder; returns the card with its hashes.

    Raises:
        ArtifactError: the folder exists; a released version is never rewritten.
    """
    check_unreleased(folder)
    folder.mkdir(parents=True, exist_ok=True)
    flat = {f"{component}/{name}": tensor for component, tensors in core.components.items() for name, tensor in tensors.items()}
    blobs = {WEIGHTS: safetensors.torch.save(flat), PROBE: safetensors.torch.save(_make_probe(core))}
    for name, blob in blobs.items():
        write_atomically(folder / name, blob)
    card = replace(card, files={name: hashlib.sha256(blob).hexdigest() for name, blob in blobs.items()})
    write_atomically(folder / README, render(card).encode())
    write_json(folder / CARD, card.to_json())  # last: a folder without a card is no core
    return read_card(folder)


def _core(card: Card, components: dict[str, dict[str, Tensor]]) -> Core:
    kinds = card.components
    ensembles = {name: typed(kinds[name].architecture, EnsembleArchitecture) for name in ENSEMBLES if name in components}
    policy = typed(kinds["policy"].architecture, Architecture)
    if (policy.obs_dim, policy.act_dim) != (card.source.obs_dim, card.source.act_dim):
        raise FormatError(f"its policy has {policy.obs_dim} inputs and {policy.act_dim} actions, its source others")
    outputs = {"critic": 1, "dynamics": Dynamics.out_dim(policy.obs_dim)}
    for name, ensemble in ensembles.items():
        if (ensemble.in_dim, ensemble.out_dim) != (policy.obs_dim + policy.act_dim, outputs[name]):
            raise FormatError(f"{name} has {ensemble.in_dim} inputs and {ensemble.out_dim} outputs")
    for name, architecture in {"policy": policy, **ensembles}.items():
        tensors = components[name].values()
        if any(len(tensor) != len(card.seeds) for tensor in tensors):
            raise FormatError(f"{name} has another number of members")
        check_enough(tensors, architecture.weights * len(card.seeds), name)
    return Core(card.id, card.source, policy, card.seeds, components, card.digest, ensembles)


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


def components_card(core: Core) -> dict[str, ComponentCard]:
    """Make the card's entries of all components of a core around which nothing is wrapped."""
    assert isinstance(core.architecture, Architecture)
    components = {"policy": policy_card(core.architecture)}
    components |= {name: ensemble_card(name, core.ensembles[name]) for name in ENSEMBLES if name in core.ensembles}
    if "normalizer" in core.components:
        components["normalizer"] = normalizer_card(core.spec.obs_dim)
    return components


def check_files(card: Card) -> None:
    """Check that the card has a hash of every file that is read.

    Raises:
        ArtifactError: one is missing, or it names another file.
    """
    if set(card.files) != {WEIGHTS, PROBE}:
        raise ArtifactError(
            f"core {card.id}: files of its card", value=sorted(card.files), allowed=f"{PROBE} and {WEIGHTS}", remedy=RESTORE
        )


def check_probe(core: Core, folder: Path) -> float:
    """Find the largest difference between the core's outputs on the stored inputs and the stored outputs.

    Raises:
        ArtifactError: it exceeds the tolerance, or the stored inputs and outputs do not fit the core.
    """
    card = read_card(folder)
    check_files(card)
    stored, members = _read(folder, PROBE, card), len(core.seeds)
    observation = stored.get("input", torch.empty(0))
    if observation.shape != (PROBE_INPUTS, core.spec.obs_dim) or observation.dtype != torch.float32:
        raise ArtifactError(f"core {core.id}: {PROBE} has no inputs of its source", remedy=RESTORE)
    outputs = [_outputs(core, member, observation) for member in range(members)]
    fits = {name: name in stored and stored[name].shape == (members, *output.shape) for name, output in outputs[0].items()}
    if not all(fits.values()):
        raise ArtifactError(f"core {core.id}: {PROBE} has other outputs than its components", remedy=RESTORE)
    differences = [(own[name] - stored[name][k]).abs().max() for k, own in enumerate(outputs) for name in own]
    worst = float(torch.stack(differences).max())  # NaN if one is
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


def _read(folder: Path, name: str, card: Card) -> dict[str, Tensor]:
    try:
        tensors, _ = parse_tensors(_read_bytes(folder, name, card))
        if strange := [key for key, tensor in tensors.items() if not tensor.is_floating_point()]:
            raise FormatError(f"{strange[0]} has whole numbers")
        return tensors
    except FormatError as error:
        raise ArtifactError(f"core {card.id}: {name}: {error}", remedy=RESTORE) from None


def _read_bytes(folder: Path, name: str, card: Card) -> bytes:
    """Read a file after its size, and check its hash."""
    try:
        data = read_bytes(folder / name, LARGEST, follow=False)
    except FileNotFoundError:
        raise ArtifactError(f"core {card.id} lacks its file {name}", remedy=RESTORE) from None
    except OSError as error:
        raise ArtifactError(f"core {card.id}: {name} cannot be read: {error.strerror}", remedy=RESTORE) from None
    except FormatError as error:
        raise ArtifactError(f"core {card.id}: {name}: {error}", remedy=RESTORE) from None
    if hashlib.sha256(data).hexdigest() != card.files[name]:
        raise ArtifactError(f"core {card.id}: {name} is truncated or was changed", remedy=RESTORE)
    return data
