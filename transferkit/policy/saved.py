"""Policies in run directories: what a finished run holds, saved and loaded."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import Any

import torch
from torch import nn

from transferkit.errors import RunDirectoryError
from transferkit.nn import Ensemble, EnsembleArchitecture
from transferkit.policy.base import Policy
from transferkit.policy.wrap import build
from transferkit.run import POLICY, load_state

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


def _architecture(module: nn.Module) -> dict[str, Any] | None:
    """Describe an ensemble that wraps nothing."""
    ensemble = getattr(module, "ensemble", None)
    return ensemble.architecture.to_json() if isinstance(ensemble, Ensemble) else None


def _weights(module: nn.Module) -> dict[str, torch.Tensor]:
    return {name: tensor.cpu() for name, tensor in module.state_dict().items()}
