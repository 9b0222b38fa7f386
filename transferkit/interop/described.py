"""A policy beside its descriptor: turned to the order, signs, units and default pose that an environment has."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING

import torch
from torch import Tensor

from transferkit.descriptors import compare, read_descriptor, remap
from transferkit.interop.foreign import Layer
from transferkit.reading import FormatError

if TYPE_CHECKING:
    from transferkit.descriptors import Remap
    from transferkit.interop.foreign import Foreign, Given, Statistics
    from transferkit.spec import IOSpec


def described(foreign: Foreign, spec: IOSpec, given: Given) -> tuple[Foreign, list[str]]:
    """Take what the given descriptor says, if there is one; returns what differs from the environment, in lines.

    Raises:
        ArtifactError: the descriptor is damaged.
        FormatError: it is of another policy.
    """
    if given.descriptor is None:
        return foreign, []
    descriptor = read_descriptor(Path(given.descriptor))
    layers = foreign.layers
    own = layers[0].weight.shape[1], len(layers[-1].bias)
    if own != (len(descriptor.observation), len(descriptor.action)):
        said = f"{len(descriptor.observation)} observations and {len(descriptor.action)} actions"
        raise FormatError(f"its descriptor has {said}, its policy {own[0]} and {own[1]}")
    rows = [row for row in compare(descriptor, spec) if row.differs]
    notes = [f"{row.part} {row.index}, {row.described}: {row.verdict}, {row.detail or row.measured}" for row in rows]
    found = remap(descriptor, spec)
    if found is None:
        return foreign, [*notes, "the descriptor and the environment do not have the same numbers, so nothing is reordered"]
    units = torch.tensor(found.units, dtype=torch.float64)
    notes += ["the core takes the environment's numbers as they are, and turns them as the descriptor says"] * found.moves
    return replace(_turned(foreign, found) if found.moves else foreign, units=units), [*notes, *descriptor.notes]


def _turned(foreign: Foreign, found: Remap) -> Foreign:
    scale, shift = (torch.tensor(one, dtype=torch.float64) for one in (found.scale, found.shift))
    order = [found.source.index(k) for k in range(len(found.source))]
    layers, statistics = list(foreign.layers), foreign.statistics
    layers[0], statistics = _inputs(layers[0], statistics, scale, shift, order)
    rows = list(found.outputs)
    layers[-1] = Layer(layers[-1].weight[rows], layers[-1].bias[rows])
    log_std = None if foreign.log_std is None else foreign.log_std[rows]
    left = ["its critics are left out, which take other numbers"] if foreign.critics else []
    return replace(foreign, layers=layers, statistics=statistics, log_std=log_std, critics=(), notes=[*foreign.notes, *left])


def _inputs(
    layer: Layer, statistics: Statistics | None, scale: Tensor, shift: Tensor, order: Sequence[int]
) -> tuple[Layer, Statistics | None]:
    """The first layer and its statistics for `x` of which `scale * x[...] + shift` is what they took."""
    if statistics is None:
        weight = layer.weight * scale
        return Layer(weight[:, order], layer.bias + layer.weight @ shift), None
    mean, var = (statistics.mean - shift) / scale, statistics.var / scale**2
    return Layer((layer.weight * scale.sign())[:, order], layer.bias), replace(statistics, mean=mean[order], var=var[order])
