"""A core from what another library saved: its own layers, in our units.

Observation statistics, clip ranges and the scale of actions become part of the numbers, so that both act the same.
"""

from __future__ import annotations

import itertools
from collections.abc import Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import torch
from torch import Tensor

from transferkit.errors import ConfigError, DimensionError
from transferkit.interop.critics import critics_of
from transferkit.interop.foreign import Layer
from transferkit.interop.names import check_activation
from transferkit.nn import Architecture, gaussian
from transferkit.nn.normalizer import CLIP, EPSILON
from transferkit.policy.core import Core, stack_members
from transferkit.reading import FormatError, typed

if TYPE_CHECKING:
    from transferkit.interop.foreign import Foreign, Given, Statistics
    from transferkit.spec import IOSpec

UNCLIPPED = 100.0
"""Standard deviations at which a core clips what the library does not clip."""

STD = 0.3
"""Of exploration, where the library's cannot be had: that of DYNA-DDPG's new policies."""


@dataclass(frozen=True)
class Actions:
    """What an output of the file is in our actions: `scale * output + shift`, both `(act_dim,)`."""

    scale: Tensor
    shift: Tensor


def build_core(foreign: Foreign, spec: IOSpec, given: Given, name: str, digest: str) -> tuple[Core, list[str]]:
    """Make a core of one member, and say what was assumed or left out.

    Raises:
        ConfigError: the file does not say something, and neither does the user.
        DimensionError: it does not fit the environment.
        FormatError: no network of ours computes the same.
    """
    _check_chain(foreign.layers, spec, name)
    activation = _activation(foreign, given)
    actions, statistics = _actions(foreign, spec, given), foreign.statistics
    layers, notes = list(foreign.layers), list(foreign.notes)
    if foreign.usual and given.activation is None:
        notes.append(f"activation {activation}, the library's usual one")
    if not foreign.usual and foreign.activation not in (None, activation):
        notes.append(f"activation {activation}, where the file says {foreign.activation}")
    if foreign.critics and foreign.statistics is not None:
        notes.append("its critics value rewards as its training scaled them")
    components: dict[str, Any] = {}
    factors = torch.ones(spec.obs_dim, dtype=torch.float64)
    if statistics is not None:
        normalizer, factors = _normalizer(statistics, spec.obs_dim)
        components["normalizer"] = stack_members([normalizer])
        if statistics.clip is None:
            notes.append(f"the library clips no observation, the core at {UNCLIPPED:g} standard deviations")
    layers[0] = Layer(layers[0].weight * factors, layers[0].bias)
    if not foreign.squash:
        layers[-1] = Layer(layers[-1].weight * actions.scale[:, None], layers[-1].bias * actions.scale + actions.shift)
    log_std, said = _log_std(foreign, given, actions)
    shape = {"obs_dim": spec.obs_dim, "act_dim": spec.act_dim, "hidden": [len(layer.bias) for layer in layers[:-1]]}
    architecture = typed({**shape, "activation": activation, "squash": foreign.squash}, Architecture)
    components["policy"] = stack_members([_state(layers, log_std)])
    critics, ensemble, left_out = critics_of(foreign, activation, spec, factors)
    if ensemble is not None:
        components["critic"] = stack_members([critics])
    core = Core(name, spec, architecture, (0,), components, digest, {} if ensemble is None else {"critic": ensemble})
    return core, [*notes, *said, *left_out]


def _check_chain(layers: Sequence[Layer], spec: IOSpec, name: str) -> None:
    if len(layers) < 2:
        raise FormatError("it has no hidden layer")
    if any(len(one.bias) != other.weight.shape[1] for one, other in itertools.pairwise(layers)):
        raise FormatError("its layers do not fit each other")
    own = layers[0].weight.shape[1], len(layers[-1].bias)
    if own != (spec.obs_dim, spec.act_dim):
        raise DimensionError(
            f"{name} takes {own[0]} observations and gives {own[1]} actions, environment {spec.env_id} has {spec.obs_dim} and "
            f"{spec.act_dim}",
            remedy="name the environment that it was trained in with {env}",
            topic="environments",
        )


def _activation(foreign: Foreign, given: Given) -> str:
    if given.activation is not None:
        return check_activation(given.activation)
    if foreign.activation is None:
        raise ConfigError("the file does not say the activation of its hidden layers", remedy="give {activation}, such as elu")
    return foreign.activation


def _actions(foreign: Foreign, spec: IOSpec, given: Given) -> Actions:
    """What its outputs are in our actions, which are -1 to 1 between the environment's bounds."""
    low, high = (torch.tensor([getattr(one, end) for one in spec.action], dtype=torch.float64) for end in ("low", "high"))
    centre, half = (low + high) / 2, (high - low) / 2
    said = foreign.outputs if foreign.units is None else foreign.units
    outputs = said if given.action_scale is None else given.action_scale
    if outputs is None:
        raise ConfigError(
            "the file does not say what an action of 1 is in the environment",
            remedy="give {action_scale}, in the environment's own units, or {action_scale=bounds}",
        )
    if given.action_scale is None and foreign.units is None and foreign.bounds is not None:
        _check_bounds(foreign.bounds, low, high, spec.env_id)
    if isinstance(outputs, str) and foreign.gain == 1:
        return Actions(torch.ones_like(half), torch.zeros_like(half))
    outputs = foreign.gain * half if isinstance(outputs, str) else foreign.gain * outputs + torch.zeros_like(half)
    actions = Actions(outputs / half, -centre / half)
    if foreign.squash and not (torch.allclose(actions.scale, torch.ones_like(half)) and bool((centre == 0).all())):
        raise FormatError(
            f"its actions go to {outputs.tolist()} by tanh, those of {spec.env_id} from {low.tolist()} to {high.tolist()}"
        )
    return actions


def _check_bounds(bounds: tuple[float, float], low: Tensor, high: Tensor, env: str) -> None:
    if not all(torch.allclose(own, torch.full_like(own, said)) for own, said in zip((low, high), bounds, strict=True)):
        raise ConfigError(
            f"the file's actions go from {bounds[0]:g} to {bounds[1]:g}, those of {env} from {low.tolist()} to {high.tolist()}",
            remedy="give {action_scale}, the environment's units of an output of 1, or {action_scale=bounds}",
        )


def _normalizer(statistics: Statistics, obs_dim: int) -> tuple[dict[str, Tensor], Tensor]:
    """Statistics of a `Normalizer`, and factors of the first layer's inputs, which together do what the library's do.

    `clip(z, c)` is `c / 10` times `clip(10 / c * z, 10)`.
    """
    if len(statistics.mean) != obs_dim:
        raise FormatError(f"its statistics are of {len(statistics.mean)} observations, its policy takes {obs_dim}")
    share = (UNCLIPPED if statistics.clip is None else statistics.clip) / CLIP
    if not 1e-3 <= share <= 1e3:
        raise FormatError(f"it clips observations at {share * CLIP:g} standard deviations")
    var = (statistics.var * share**2 - EPSILON).clamp(min=0.0).float()
    factors = ((var.double() + EPSILON) / statistics.var.clamp(min=1e-30)).sqrt()
    count = torch.tensor(statistics.count, dtype=torch.float64)
    return {"mean": statistics.mean.float(), "var": var, "count": count}, factors


def _log_std(foreign: Foreign, given: Given, actions: Actions) -> tuple[Tensor, list[str]]:
    low, high = gaussian.LOG_STD_BOUNDS
    if given.std is None and foreign.log_std is not None:
        log_std = foreign.log_std + actions.scale.abs().log()
        beyond = bool(((log_std < low) | (log_std > high)).any())
        return log_std, ["its exploration is outside the range of a core's and is clipped"] * beyond
    std = STD if given.std is None else given.std
    said = f"explores with a standard deviation of {std:g}"
    return torch.full_like(actions.shift, std).log(), [said] * (given.std is None)


def _state(layers: Sequence[Layer], log_std: Tensor) -> dict[str, Tensor]:
    names = [f"body.{2 * k}" for k in range(len(layers) - 1)] + ["mean_head"]
    state = {f"{name}.weight": layer.weight for name, layer in zip(names, layers, strict=True)}
    state |= {f"{name}.bias": layer.bias for name, layer in zip(names, layers, strict=True)}
    single = {name: tensor.float() for name, tensor in {**state, "log_std": log_std}.items()}
    if not all(torch.isfinite(tensor).all() for tensor in single.values()):
        raise FormatError("its numbers are not finite in float32")
    return single
