"""NVIDIA's LEAPP YAML, 1.1 to 1.3: the ports of a model with their kinds and the names of their elements."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import TYPE_CHECKING, Annotated, Any

import msgspec

from transferkit.descriptors.form import AXES, Channel, Descriptor, check_size
from transferkit.reading import FormatError, Size

if TYPE_CHECKING:
    from transferkit.descriptors.form import Kind

OTHER: Kind = "other"

KINDS: Mapping[str, Kind] = {
    "state/joint/position": "joint position",
    "state/joint/velocity": "joint velocity",
    "state/body/position": "body position",
    "state/body/linear_velocity": "linear velocity",
    "state/body/angular_velocity": "angular velocity",
    "target/joint/position": "joint position",
    "target/joint/velocity": "joint velocity",
    "target/joint/torques": "joint torque",
    "target/joint/effort": "joint torque",
}

GAINS = ("kp", "kd")
"""Kinds of outputs that are no commands."""


@dataclass(frozen=True)
class Port:
    """An input or an output."""

    name: str
    shape: tuple[Size, ...] = ()
    kind: str | None = None
    element_names: Any = None
    """Names along each axis, or along the last one alone."""


@dataclass(frozen=True)
class Model:
    """A network; the order of its ports is that of the file it stands for."""

    inputs: tuple[Port, ...]
    outputs: tuple[Port, ...]


@dataclass(frozen=True)
class Configs:
    """Of the pipeline, from 1.3 on."""

    frequency: Annotated[float, msgspec.Meta(gt=0)] | None = None
    """Hertz."""


@dataclass(frozen=True)
class Pipeline:
    """How models are joined."""

    feedback_flow: Mapping[str, tuple[str, ...]] = field(default_factory=dict)
    """Outputs, as `model/port`, that become inputs in the next step."""
    configs: Configs | None = None


@dataclass(frozen=True)
class Leapp:
    """The file."""

    models: Mapping[str, Model]
    pipeline: Pipeline


def read_leapp(file: Leapp) -> Descriptor:
    """Take its only model.

    Raises:
        FormatError: it has several, or names that do not fit.
    """
    if len(file.models) != 1:
        raise FormatError(f"it has {len(file.models)} models, one is read")
    ((name, model),) = file.models.items()
    back = file.pipeline.feedback_flow
    past = {port for ports in back.values() for port in ports}
    inputs = [port for port in model.inputs if f"{name}/{port.name}" not in past]
    outputs = [port for port in model.outputs if f"{name}/{port.name}" not in back and port.kind not in GAINS]
    notes = tuple(f"{one} is fed back and not compared" for one in sorted(past))
    frequency = file.pipeline.configs.frequency if file.pipeline.configs else None
    observation, action = (tuple(channel for port in ports for channel in _channels(port)) for ports in (inputs, outputs))
    return Descriptor("LEAPP", observation, action, 1 / frequency if frequency else None, notes)


def _channels(port: Port) -> list[Channel]:
    size = math.prod(port.shape)
    check_size(port.name, size)
    kind = KINDS.get(port.kind or "", OTHER)
    names = _names(port, size)
    if names is None:
        axes = kind in ("linear velocity", "angular velocity", "body position") and size == len(AXES)
        kind = kind if axes else OTHER
        names = list(AXES) if axes else [port.name if size == 1 else f"{port.name}[{k}]" for k in range(size)]
    return [Channel(kind, name) for name in names]


def _names(port: Port, size: int) -> list[str] | None:
    """Names of the elements along the last axis, in the forms that exporters write."""
    listed = port.element_names
    if isinstance(listed, tuple | list) and listed and isinstance(listed[-1], tuple | list):
        listed = listed[-1]
    if not listed or not isinstance(listed, tuple | list):
        return None
    if len(listed) != size or not all(isinstance(one, str) for one in listed):
        raise FormatError(f"port {port.name} has {size} numbers and {len(listed)} element names")
    return list(listed)
