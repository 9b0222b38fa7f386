"""ONNX files that are an MLP: linear layers, one activation, statistics in front, tanh at the end. Nothing is executed."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING

import torch

from transferkit.interop.foreign import Foreign, Layer, Statistics
from transferkit.interop.onnx_graph import Affine, Clip, Nonlinear, Sized, read_graph
from transferkit.reading import FormatError

if TYPE_CHECKING:
    from transferkit.interop.onnx_graph import Step


OWN = {"action_low", "action_high", "known_output"}
"""Properties of a file of `export_onnx`, whose outputs are in the environment's own units."""


def read_onnx(data: bytes) -> Foreign:
    """Read a policy; what its outputs are in the environment, no graph says, but a file of `export_onnx` does.

    Raises:
        ConfigError: the package onnx is not installed.
        FormatError: it is damaged, or not a plain MLP.
    """
    graph, properties = read_graph(data)
    steps = _fused(graph)
    first = next((k for k, step in enumerate(steps) if isinstance(step, Layer)), len(steps))
    statistics = _statistics(steps[:first])
    layers, activations, end = _mlp(steps[first:])
    if len(set(activations)) != 1:
        raise FormatError(f"it has the activations {sorted(set(activations))}; one for all hidden layers is read")
    squash, gain, notes = _end(end)
    if not squash:
        layers[-1] = Layer(layers[-1].weight * gain, layers[-1].bias * gain)
    return Foreign(
        "ONNX",
        layers,
        activations[0],
        1.0 if properties >= OWN else None,
        squash=squash,
        gain=gain if squash else 1.0,
        statistics=statistics,
        normalized=statistics is not None,
        notes=notes,
    )


def _fused(steps: Sequence[Step]) -> list[Step]:
    """Join what is elementwise with the linear layer or the elementwise step before it."""
    fused: list[Step] = []
    for step in steps:
        before = fused[-1] if fused else None
        if isinstance(step, Affine) and isinstance(before, Layer):
            _check_size(step, len(before.bias))
            scale = step.scale.expand(len(before.bias))
            fused[-1] = Layer(before.weight * scale[:, None], before.bias * scale + step.shift)
        elif isinstance(step, Affine) and isinstance(before, Affine):
            _check_size(step, len(before.scale))
            fused[-1] = Affine(before.scale * step.scale, before.shift * step.scale + step.shift)
        elif isinstance(step, Sized):
            if isinstance(before, Layer) and step.size not in (-1, len(before.bias)):
                raise FormatError(f"it reshapes {len(before.bias)} numbers to rows of {step.size}")
        else:
            fused.append(step)
    return fused


def _check_size(step: Affine, size: int) -> None:
    if size != 1 and len(step.scale) not in (1, size):
        raise FormatError(f"it adds or multiplies {len(step.scale)} numbers to {size}")


def _mlp(steps: Sequence[Step]) -> tuple[list[Layer], list[str], Sequence[Step]]:
    """The layers, the activations between them, and what follows the last."""
    layers, activations = [], []
    for k in range(0, len(steps), 2):
        layer, after = steps[k], steps[k + 1 : k + 3]
        if not isinstance(layer, Layer):
            break
        layers.append(layer)
        if len(after) == 2 and isinstance(after[0], Nonlinear) and isinstance(after[1], Layer):
            activations.append(after[0].name)
        else:
            return layers, activations, steps[k + 1 :]
    raise FormatError("it is not a chain of linear layers with activations between them")


def _end(steps: Sequence[Step]) -> tuple[bool, float, list[str]]:
    """What follows the last layer: perhaps tanh, a clip, one scale for all actions, and a clip again."""
    rest, gain, notes = list(steps), 1.0, []
    squash = rest[:1] == [Nonlinear("tanh")]
    rest = rest[1:] if squash else rest
    for step in rest[:3]:
        if isinstance(step, Clip):
            low, high = step.low, step.high
            notes = [] if squash else [f"it clips its outputs from {low:g} to {high:g}, a core at the environment's bounds"]
            if squash and (low > -gain or high < gain):
                raise FormatError("it clips its outputs behind tanh")
        elif isinstance(step, Affine) and gain == 1 and step.scale[0] > 0:
            if bool((step.scale != step.scale[:1]).any()) or bool((step.shift != 0).any()):
                raise FormatError("its outputs are not scaled alike, or are shifted")
            gain = float(step.scale[0])
        else:
            raise FormatError(f"its last layer is followed by {type(step).__name__.lower()}, which is not read")
    if rest[3:]:
        raise FormatError("its last layer is followed by more than tanh, clips and a scale")
    return squash, gain, notes


def _statistics(steps: Sequence[Step]) -> Statistics | None:
    """What stands in front of the first layer: `scale * x + shift`, perhaps clipped."""
    if not steps:
        return None
    front, clip = steps[0], steps[1:]
    if not isinstance(front, Affine) or len(clip) > 1 or not all(isinstance(step, Clip) for step in clip):
        raise FormatError("in front of its first layer is something else than statistics and a clip")
    if not bool((front.scale > 0).all()):
        raise FormatError("its observations are turned round in front of its first layer")
    limits = [limit for step in clip if isinstance(step, Clip) for limit in (-step.low, step.high)]
    if limits and (limits[0] != limits[1] or not 0 < limits[0] < torch.inf):
        raise FormatError("it clips observations on one side, or not alike on both")
    scale, shift = (one.expand(max(len(front.scale), len(front.shift))) for one in (front.scale, front.shift))
    return Statistics(-shift / scale, scale**-2, limits[0] if limits else None, 1.0)
