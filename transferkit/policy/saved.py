"""Policies in run directories: what a finished run holds, saved and loaded."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import TYPE_CHECKING, Any

import torch
from torch import nn

from transferkit.config.wrap import PAPER_WRAP, WrapConfig
from transferkit.errors import RunDirectoryError
from transferkit.nn import Architecture, Ensemble, EnsembleArchitecture, Normalizer, PolicyNet
from transferkit.policy.base import ConstantPolicy, ScratchPolicy
from transferkit.policy.match import match_for
from transferkit.policy.paper import PaperSandwich
from transferkit.policy.sandwich import Sandwich
from transferkit.run import POLICY, load_state
from transferkit.spec import IOSpec

if TYPE_CHECKING:
    from transferkit.policy.base import Policy

Component = tuple[EnsembleArchitecture, dict[str, torch.Tensor]]
"""Architecture and weights of an ensemble."""


def state_of(policy: Policy, beside: Mapping[str, nn.Module]) -> dict[str, Any]:
    """Collect a trained policy, and what was trained beside it, for `RunDirectory.save_policy`."""
    others = {name: {"architecture": _architecture(module), "weights": _weights(module)} for name, module in beside.items()}
    return {"blueprint": policy.blueprint(), "weights": _weights(policy), "parts": others}


def load_policy(run_dir: str | Path) -> Policy:
    """Load the final policy of a finished run, with its normaliser.

    Raises:
        RunDirectoryError: the run is not finished, or its policy file is damaged.
    """
    state = load_saved(run_dir)
    try:
        policy = build(state["blueprint"])
        policy.load_state_dict(state["weights"])
    except (KeyError, TypeError, ValueError, RuntimeError) as error:
        reason = " ".join(str(error).split())[:200]
        raise RunDirectoryError(
            f"{Path(run_dir) / POLICY} holds no policy of this version ({reason})", remedy="train again"
        ) from None
    return policy


def load_components(run_dir: str | Path) -> dict[str, Component]:
    """Load what a finished run trained from scratch beside its policy for a core to keep: `critic`, `dynamics`, or nothing."""
    return {
        name: (EnsembleArchitecture.from_json(saved["architecture"]), saved["weights"])
        for name, saved in load_saved(run_dir)["parts"].items()
        if saved["architecture"]
    }


def load_saved(run_dir: str | Path) -> dict[str, Any]:
    """Load what `state_of` collected.

    Raises:
        RunDirectoryError: the run is not finished, or its policy file is damaged.
    """
    path = Path(run_dir) / POLICY
    if not path.exists():
        raise RunDirectoryError(f"{run_dir} holds no finished run", remedy="finish it with {resume=True}")
    return load_state(path)


def build(blueprint: Mapping[str, Any]) -> Policy:
    """Build the policy of a blueprint with zero weights; load its state dict next.

    Raises:
        KeyError, TypeError, ValueError: not a blueprint of this version.
    """
    if blueprint["kind"] == "constant":
        return ConstantPolicy(blueprint["obs_dim"], blueprint["act_dim"])
    if blueprint["kind"] == "scratch":
        architecture = Architecture.from_json(blueprint["architecture"])
        return ScratchPolicy.create(architecture, None, init_std=1.0, normalize=blueprint["normalize"])
    network = PolicyNet(Architecture.from_json(blueprint["core"]))
    specs = IOSpec.from_json(blueprint["source"]), IOSpec.from_json(blueprint["target"])
    if blueprint["kind"] == "paper":
        return PaperSandwich(network, specs, PAPER_WRAP, None)
    options = {name: blueprint[name] for name in ("tap", "adapter", "finetune", "residual")}
    normalizer = Normalizer(specs[0].obs_dim) if blueprint["source_normalizer"] else None
    config = WrapConfig(**options, lr_scale={}, init_std=1.0)
    return Sandwich(network, normalizer, specs, config, match_for(config.adapter, *specs), None)


def as_saved(policy: Policy) -> Policy:
    """Copy a policy with memory of its own, as `load_policy` makes it.

    Training keeps the weights as views of one buffer, and their alignment changes the last bits of an action.
    """
    copy = build(policy.blueprint())
    copy.load_state_dict(policy.state_dict())
    return copy


def _architecture(module: nn.Module) -> dict[str, Any] | None:
    """Describe an ensemble that wraps nothing."""
    ensemble = getattr(module, "ensemble", None)
    return ensemble.architecture.to_json() if isinstance(ensemble, Ensemble) else None


def _weights(module: nn.Module) -> dict[str, torch.Tensor]:
    return {name: tensor.cpu() for name, tensor in module.state_dict().items()}
