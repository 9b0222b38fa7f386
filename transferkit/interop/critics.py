"""Critics of another library as those of a core, if they compute the same."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING

import torch
from torch import Tensor

from transferkit.nn import EnsembleArchitecture
from transferkit.reading import typed

if TYPE_CHECKING:
    from transferkit.interop.foreign import Foreign, Layer
    from transferkit.spec import IOSpec


def critics_of(
    foreign: Foreign, activation: str, spec: IOSpec, factors: Tensor
) -> tuple[dict[str, Tensor], EnsembleArchitecture | None, list[str]]:
    """Make the weights of an ensemble, or say why there is none.

    Args:
        foreign: what the file holds.
        activation: of its hidden layers; an ensemble has rectified units.
        spec: of the environment.
        factors: of the observation's inputs, `(obs_dim,)`, as in the policy.
    """
    if not foreign.critics:
        return {}, None, []
    shapes = {tuple(layer.weight.shape for layer in critic) for critic in foreign.critics}
    first = foreign.critics[0]
    inputs = spec.obs_dim + spec.act_dim
    if activation != "relu":
        return {}, None, [f"its critics have {activation} and not relu, and are left out"]
    if len(shapes) > 1 or len(first) < 2 or not _fits(first, inputs):
        return {}, None, ["its critics are not alike, or not of an observation and an action, and are left out"]
    stacked = [_stack([critic[k] for critic in foreign.critics]) for k in range(len(first))]
    stacked[0] = _in_our_units(*stacked[0], spec, factors, scaled=foreign.critic_actions != "bounds")
    names = [f"body.{k}" for k in range(len(first) - 1)] + ["head"]
    state = {}
    for name, (weight, bias) in zip(names, stacked, strict=True):
        state |= {f"ensemble.{name}.weight": weight.float().contiguous(), f"ensemble.{name}.bias": bias.float()}
    hidden = [len(layer.bias) for layer in first[:-1]]
    shape = {"members": len(foreign.critics), "in_dim": inputs, "out_dim": 1, "hidden": hidden, "layer_norm": False}
    return state, typed(shape, EnsembleArchitecture), []


def _fits(layers: Sequence[Layer], inputs: int) -> bool:
    sizes = [inputs, *(len(layer.bias) for layer in layers)]
    return sizes[-1] == 1 and all(layer.weight.shape[1] == size for layer, size in zip(layers, sizes, strict=False))


def _stack(layers: Sequence[Layer]) -> tuple[Tensor, Tensor]:
    """`(E, in, out)` and `(E, 1, out)`."""
    return torch.stack([layer.weight.T for layer in layers]), torch.stack([layer.bias[None] for layer in layers])


def _in_our_units(weight: Tensor, bias: Tensor, spec: IOSpec, factors: Tensor, *, scaled: bool) -> tuple[Tensor, Tensor]:
    """Let the first layer take observations as the core's normaliser gives them, and actions from -1 to 1."""
    observation, action = weight[:, : spec.obs_dim] * factors[:, None], weight[:, spec.obs_dim :]
    if scaled:
        numbers = ([getattr(one, of) for one in spec.action] for of in ("centre", "half_range"))
        centre, half = (torch.tensor(row, dtype=torch.float64) for row in numbers)
        bias = bias + (centre @ action)[:, None]
        action = action * half[:, None]
    return torch.cat([observation, action], 1), bias
