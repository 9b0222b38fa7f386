"""Checkpoints of rsl_rl 2 to 5, as Isaac Lab and mjlab write them, with their normaliser."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import torch

from transferkit.interop.foreign import Foreign, Statistics, chain, tensor
from transferkit.reading import FormatError

EPSILON = 1e-2
"""What `EmpiricalNormalization` adds to the standard deviation."""

LAYOUTS = (
    # checkpoint's key, versions, prefix of the actor, prefix of its normaliser, names of the deviation
    ("actor_state_dict", "4 or 5", "mlp.", "obs_normalizer.", ("distribution.std_param", "std")),
    ("model_state_dict", "2 or 3", "actor.", "actor_obs_normalizer.", ("std",)),
)
LOGARITHMS = ("distribution.log_std_param", "log_std")


def is_rsl_rl(saved: object) -> bool:
    """Whether a torch file holds a checkpoint of rsl_rl's runner."""
    return isinstance(saved, Mapping) and "iter" in saved and any(layout[0] in saved for layout in LAYOUTS)


def read_rsl_rl(saved: Mapping[str, Any]) -> Foreign:
    """Read a policy.

    Raises:
        FormatError: it is not a plain MLP with one deviation an action.
    """
    key, versions, actor, normalizer, deviations = next(layout for layout in LAYOUTS if layout[0] in saved)
    state = saved[key]
    if not isinstance(state, Mapping):
        raise FormatError(f"its {key} is not a state dict")
    if memory := [name for name in state if name.startswith(("memory", "rnn", "cnn", "student"))]:
        raise FormatError(f"it has {memory[0]}; only plain MLPs are read")
    layers, log_std = chain(state, actor), None
    for name in (*deviations, *LOGARITHMS):
        if name in state:
            value = tensor(state, name).flatten()
            log_std = value if name in LOGARITHMS else value.clamp(min=1e-6).log()
    if log_std is None or not layers or len(log_std) != len(layers[-1].bias):
        raise FormatError("it has not one standard deviation an action: its head depends on the state, or it has no actor")
    beside = saved.get("obs_norm_state_dict")
    held, prefix = (beside, "") if isinstance(beside, Mapping) else (state, normalizer)
    statistics = _statistics(held, prefix) if f"{prefix}_mean" in held else None
    return Foreign(
        f"rsl_rl {versions}",
        layers,
        None,
        None,
        statistics=statistics,
        normalized=statistics is not None,
        log_std=log_std,
        notes=["its critic values states alone and is left out"],
    )


def _statistics(state: Mapping[str, Any], prefix: str) -> Statistics:
    mean, std = (tensor(state, f"{prefix}{name}").flatten() for name in ("_mean", "_std"))
    if mean.shape != std.shape or bool((std < 0).any()):
        raise FormatError("its normaliser has a negative deviation, or two shapes")
    count = state.get(f"{prefix}count")
    seen = float(count) if isinstance(count, torch.Tensor) and count.numel() == 1 and count >= 0 else 1.0
    return Statistics(mean, (std + EPSILON) ** 2, None, seen)
