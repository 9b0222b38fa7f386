"""The graph of an ONNX file as a chain of steps from its input to its first output."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Any, TypeAlias

import torch
from torch import Tensor

from transferkit.extras import import_extra
from transferkit.interop.foreign import Layer
from transferkit.reading import FormatError

ACTIVATIONS = {
    "Elu": ("elu", 1.0),
    "Gelu": ("gelu", None),
    "LeakyRelu": ("leaky_relu", 0.01),
    "Mish": ("mish", None),
    "Relu": ("relu", None),
    "Selu": ("selu", 1.673263),
    "Sigmoid": ("sigmoid", None),
    "Softplus": ("softplus", None),
    "Tanh": ("tanh", None),
}
"""Names in ONNX, ours, and the `alpha` that ours has."""

LONGEST = 1000
"""Operations of a chain."""

PASS = ("Identity", "Flatten", "Dropout", "Expand")
"""Operations that change no number of a row; torch's distributions expand to the shape that is there."""


FLOATS = (1, 11)
"""ONNX's codes of float32 and float64."""


@dataclass(frozen=True)
class Affine:
    """`scale * x + shift` for each element."""

    scale: Tensor
    shift: Tensor


@dataclass(frozen=True)
class Clip:
    """Between two numbers."""

    low: float
    high: float


@dataclass(frozen=True)
class Nonlinear:
    """An activation."""

    name: str


@dataclass(frozen=True)
class Sized:
    """Rows of so many numbers; -1 if it is not said."""

    size: int


Step: TypeAlias = Layer | Affine | Clip | Nonlinear | Sized


def read_graph(data: bytes) -> tuple[list[Step], set[str]]:
    """Read the chain, and the names of what its writer said beside it.

    Raises:
        ConfigError: the package onnx cannot be imported.
        FormatError: it is damaged, or something in it is not read.
    """
    onnx = import_extra("onnx", "onnx", "an ONNX file")
    try:
        model = onnx.load_model_from_string(data)
    except Exception:  # of protobuf, in many lines
        raise FormatError("it is not an ONNX model, or damaged") from None
    graph = _Graph(onnx, model.graph, len(data))
    steps, value = list[Step](), graph.output
    for _ in range(LONGEST):
        if value == graph.input:
            return steps[::-1], {said.key for said in model.metadata_props}
        step, value = graph.step(value)
        steps += [] if step is None else [step]
    raise FormatError(f"its graph is not a chain of at most {LONGEST} operations")


class _Graph:
    """Nodes by their outputs, and constants."""

    def __init__(self, onnx: Any, graph: Any, size: int) -> None:  # noqa: ANN401 - an optional package
        self._onnx, self._size = onnx, size
        self._nodes = {output: node for node in graph.node for output in node.output}
        self._tensors = {tensor.name: tensor for tensor in graph.initializer}
        for node in graph.node:
            if node.op_type == "Constant" and node.attribute and node.attribute[0].HasField("t"):
                self._tensors[node.output[0]] = node.attribute[0].t
        inputs = [value.name for value in graph.input if value.name not in self._tensors]
        if len(inputs) != 1 or not graph.output:
            raise FormatError(f"it has the inputs {inputs}, one is read")
        self.input, self.output = inputs[0], graph.output[0].name

    def step(self, value: str) -> tuple[Step | None, str]:
        """What makes a value, and of which one."""
        node = self._nodes.get(value)
        if node is None or node.domain not in ("", "ai.onnx"):
            raise FormatError("its graph is not a chain of known operations from its input")
        if silu := self._silu(node):
            return Nonlinear("silu"), silu
        inputs = node.input[:1] if node.op_type == "Expand" else node.input
        before = [name for name in inputs if name and name not in self._tensors]
        if len(before) != 1:
            raise FormatError(f"an operation {node.op_type} of it joins {len(before)} values; only plain MLPs are read")
        return self._read(node, before[0]), before[0]

    def _silu(self, node: Any) -> str | None:  # noqa: ANN401
        """`x * sigmoid(x)`, which ONNX writes as two operations."""
        if node.op_type != "Mul":
            return None
        for inner, other in (tuple(node.input), tuple(node.input)[::-1]):
            made = self._nodes.get(inner)
            if made is not None and made.op_type == "Sigmoid" and made.input[0] == other:
                return other
        return None

    def _read(self, node: Any, before: str) -> Step | None:  # noqa: ANN401
        kind, first = node.op_type, node.input[0] == before
        if kind in PASS or (kind == "Cast" and self._attribute(node, "to", 0) in FLOATS):
            return None
        if kind in ACTIVATIONS:
            name, alpha = ACTIVATIONS[kind]
            plain = {"alpha": alpha, "approximate": b"none", "gamma": 1.050701}
            if any(self._attribute(node, key, value) != value for key, value in plain.items()):
                raise FormatError(f"its {kind} has other settings than torch's")
            return Nonlinear(name)
        if kind == "Reshape":
            shape = self._constant(node.input[1]).tolist()
            if len(shape) != 2 or shape[0] not in (-1, 0, 1):
                raise FormatError("it reshapes its values to other than rows")
            return Sized(int(shape[1]))
        if kind == "Clip":
            low, high = (self._constant(name) if name else None for name in (*node.input[1:], "", "")[:2])
            return Clip(*(end if bound is None else float(bound) for bound, end in ((low, -torch.inf), (high, torch.inf))))
        if kind in ("Gemm", "MatMul") and first:
            return self._layer(node)
        if kind in ("Add", "Sub", "Mul", "Div"):
            constant = self._constant(node.input[1 if first else 0]).flatten()
            return _affine(kind, constant, first=first)
        raise FormatError(f"its operation {kind} is not read; only plain MLPs are")

    def _layer(self, node: Any) -> Layer:  # noqa: ANN401
        weight = self._constant(node.input[1])
        plain = {"alpha": 1.0, "beta": 1.0, "transA": 0}
        if any(self._attribute(node, name, value) != value for name, value in plain.items()) or weight.dim() != 2:
            raise FormatError(f"a {node.op_type} of it is not a linear layer")
        weight = weight if self._attribute(node, "transB", 0) else weight.T
        bias = self._constant(node.input[2]).flatten() if len(node.input) > 2 else torch.zeros(len(weight), dtype=torch.float64)
        if len(bias) not in (1, len(weight)):
            raise FormatError(f"a {node.op_type} of it has a bias of {len(bias)} numbers")
        return Layer(weight, bias.expand(len(weight)))

    def _attribute(self, node: Any, name: str, default: Any) -> Any:  # noqa: ANN401
        found = [self._onnx.helper.get_attribute_value(one) for one in node.attribute if one.name == name]
        value = found[0] if found else default
        return round(value, 6) if isinstance(value, float) else value

    def _constant(self, name: str) -> Tensor:
        tensor = self._tensors.get(name)
        if tensor is None or tensor.data_location == self._onnx.TensorProto.EXTERNAL:
            raise FormatError(f"its numbers {name} are not in the file; export it with external_data=False")
        if math.prod(max(int(size), 0) for size in tensor.dims) > self._size:
            raise FormatError(f"its numbers {name} are more than the file has")
        try:
            value = torch.from_numpy(self._onnx.numpy_helper.to_array(tensor).astype("float64"))
        except Exception:  # of a type that numpy lacks, or of a wrong size
            raise FormatError(f"its numbers {name} are damaged") from None
        if not torch.isfinite(value).all():
            raise FormatError(f"its numbers {name} are not finite")
        return value


def _affine(kind: str, constant: Tensor, *, first: bool) -> Affine:
    one, zero = torch.ones_like(constant), torch.zeros_like(constant)
    if kind == "Add":
        return Affine(one, constant)
    if kind == "Sub":
        return Affine(one, -constant) if first else Affine(-one, constant)
    if kind == "Mul":
        return Affine(constant, zero)
    if not first or bool((constant == 0).any()):
        raise FormatError("it divides by zero, or a number by a value")
    return Affine(1 / constant, zero)
