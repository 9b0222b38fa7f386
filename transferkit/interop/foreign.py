"""What the file of another library holds, in the terms that all of them share, and what its user adds."""

from __future__ import annotations

import re
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Literal

import torch
from torch import Tensor

from transferkit.reading import FormatError

Scale = float | Literal["bounds"]
"""What an output of 1 is: so many of the environment's own units, or the upper bound of its actions (and -1 the lower one)."""

LINEAR = re.compile(r"(\d+)\.(weight|bias)")


@dataclass(frozen=True)
class Given:
    """What a user says beside a file; None leaves it to the file, which may say it."""

    activation: str | None = None
    """Of the hidden layers."""
    stats: str | Path | None = None
    """File of the observation statistics; `none` says that observations were not normalised."""
    action_scale: Scale | None = None
    std: float | None = None
    """Standard deviation of exploration, of an action range of [-1, 1], for what has none that a core can have."""
    descriptor: str | Path | None = None
    """File that says what its numbers are."""


@dataclass(frozen=True)
class Layer:
    """A linear layer: `(out, in)` and `(out,)`."""

    weight: Tensor
    bias: Tensor


@dataclass(frozen=True)
class Statistics:
    """Observation statistics: `(x - mean) / sqrt(var)`, clipped."""

    mean: Tensor
    """`(obs_dim,)`."""
    var: Tensor
    """`(obs_dim,)`, with what the library adds against division by zero."""
    clip: float | None
    """Standard deviations; None if the library does not clip."""
    count: float
    """Samples seen."""


@dataclass(frozen=True)
class Foreign:
    """A policy as another library saved it."""

    library: str
    layers: Sequence[Layer]
    """From the normalised observation to the mean of the action."""
    activation: str | None
    """Of the hidden layers; None if the file does not say."""
    outputs: Scale | None
    """What an output is; None if the file does not say."""
    units: Tensor | None = None
    """What an output of 1 is, in the environment's units of each action `(act_dim,)`, if a descriptor says so."""
    bounds: tuple[float, float] | None = None
    """Of the actions where it was trained, if the file says so and they are the same for all."""
    squash: bool = False
    """Whether the mean is bounded by tanh."""
    gain: float = 1.0
    """What the tanh is multiplied by."""
    statistics: Statistics | None = None
    normalized: bool | None = None
    """Whether it saw normalised observations; None if the file does not say."""
    log_std: Tensor | None = None
    """`(act_dim,)`, in the unit of the outputs; None if it has none, or one that no core can have."""
    critics: Sequence[Sequence[Layer]] = ()
    """Values of states and actions."""
    critic_actions: Scale = "bounds"
    """In what unit critics take actions."""
    usual: bool = False
    """Whether its activation is the library's usual one and not the file's word."""
    steps: int = 0
    """Environment steps of its training, if the file says so."""
    notes: Sequence[str] = ()
    """What was left out or assumed, for the user."""


def chain(state: Mapping[str, Any], prefix: str) -> list[Layer]:
    """Take the linear layers `<prefix><number>.weight` and `.bias` in their order.

    Raises:
        FormatError: something else stands among them, or there are none.
    """
    under = {name[len(prefix) :]: tensor for name, tensor in state.items() if name.startswith(prefix)}
    if strange := [name for name in under if not LINEAR.fullmatch(name)]:
        raise FormatError(f"{prefix}{strange[0]} is not of a linear layer; only plain MLPs are read")
    return [linear(state, f"{prefix}{k}") for k in sorted({int(name.partition(".")[0]) for name in under})]


def linear(state: Mapping[str, Any], name: str) -> Layer:
    """Take one linear layer.

    Raises:
        FormatError: it is missing, or not a matrix and a vector.
    """
    weight, bias = (tensor(state, f"{name}.{kind}") for kind in ("weight", "bias"))
    if weight.dim() != 2 or bias.shape != weight.shape[:1]:
        raise FormatError(f"{name} is not a linear layer: its weight has the shape {tuple(weight.shape)}")
    return Layer(weight, bias)


def tensor(state: Mapping[str, Any], name: str) -> Tensor:
    """Take finite numbers as float64.

    Raises:
        FormatError: they are missing, are none, or not finite.
    """
    value = state.get(name)
    if not isinstance(value, Tensor):
        raise FormatError(f"it has no numbers {name}")
    if not torch.isfinite(value).all():
        raise FormatError(f"{name} has NaN or infinite numbers")
    return value.double()
