"""Policies in run directories: what a finished run holds, saved and loaded."""

from __future__ import annotations

import os
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any

import torch
from torch import nn

from transferkit.config.checks import check_kind
from transferkit.errors import RunDirectoryError
from transferkit.files import damaged_run
from transferkit.nn import Ensemble, EnsembleArchitecture
from transferkit.policy.blueprints import build, plan_of
from transferkit.reading import typed
from transferkit.run import BEST, POLICY, goes_on, load_state
from transferkit.tensors import check_enough

if TYPE_CHECKING:
    from transferkit.policy.base import Policy

Component = tuple[EnsembleArchitecture, dict[str, torch.Tensor]]
"""Architecture and weights of an ensemble."""


@dataclass(frozen=True)
class SavedPart:
    """What was trained beside the policy."""

    architecture: EnsembleArchitecture | None
    weights: dict[str, torch.Tensor]


@dataclass(frozen=True)
class Saved:
    """The content of a run's policy file."""

    blueprint: dict[str, Any]
    weights: dict[str, torch.Tensor]
    parts: dict[str, SavedPart]


def state_of(policy: Policy, beside: Mapping[str, nn.Module]) -> dict[str, Any]:
    """Collect a trained policy, and what was trained beside it, for `RunDirectory.save_policy`."""
    others = {name: {"architecture": _architecture(module), "weights": _weights(module)} for name, module in beside.items()}
    return {"blueprint": policy.blueprint(), "weights": _weights(policy), "parts": others}


def load_policy(run_dir: str | Path, *, best: bool = False) -> Policy:
    """Load the final policy of a finished run, or the best that its evaluations found, with its normaliser.

    Raises:
        RunDirectoryError: the run is not finished, its policy file is damaged, or there is no best policy.
    """
    return read_policy(policy_file(run_dir, best=best))


def read_policy(path: Path) -> Policy:
    """Build the policy that a file of a run holds.

    Raises:
        RunDirectoryError: it is damaged.
    """
    saved = _read(path)
    with damaged_run(path):
        plan = plan_of(saved.blueprint)
        check_enough(saved.weights.values(), plan.weights, "its blueprint")
        policy = plan.build()
        policy.load_state_dict(saved.weights)
    return policy


def load_components(run_dir: str | Path, *, best: bool = False) -> dict[str, Component]:
    """Load what a finished run trained from scratch beside its policy for a core to keep: `critic`, `dynamics`, or nothing."""
    parts = load_saved(run_dir, best=best).parts.items()
    return {name: (saved.architecture, saved.weights) for name, saved in parts if saved.architecture is not None}


def load_saved(run_dir: str | Path, *, best: bool = False) -> Saved:
    """Load what `state_of` collected.

    Raises:
        RunDirectoryError: the run is not finished, its policy file is damaged, or there is no best policy.
    """
    return _read(policy_file(run_dir, best=best))


def _read(path: Path) -> Saved:
    state = load_state(path)
    with damaged_run(path):
        return typed(state, Saved)


def policy_file(run_dir: str | Path, *, best: bool = False) -> Path:
    """The file of a finished run's final policy, or of its best.

    Raises:
        RunDirectoryError: the run is not finished, or there is no best policy.
    """
    check_kind("run_dir", run_dir, (str, Path), "give the folder of a run")
    run = Path(run_dir)
    if not os.path.isdir(run):
        raise RunDirectoryError(f"there is no folder {run_dir}", remedy="name the folder of a run")
    if not (run / POLICY).exists() or goes_on(run):
        raise RunDirectoryError(f"{run_dir} holds no finished run", remedy="finish it with {resume=True}")
    if best and not (run / BEST).exists():
        raise RunDirectoryError(
            f"{run_dir} was evaluated only at its end, and has one policy",
            remedy="leave out {best}, or train with {eval_every}",
        )
    return run / (BEST if best else POLICY)


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
