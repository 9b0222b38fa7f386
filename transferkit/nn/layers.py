"""Layers with seeded initialisation."""

from __future__ import annotations

import itertools
import math
from collections.abc import Iterator, Sequence
from contextlib import contextmanager

import torch
from torch import nn

ACTIVATIONS: dict[str, type[nn.Module]] = {
    "elu": nn.ELU,
    "gelu": nn.GELU,
    "leaky_relu": nn.LeakyReLU,
    "mish": nn.Mish,
    "relu": nn.ReLU,
    "selu": nn.SELU,
    "sigmoid": nn.Sigmoid,
    "silu": nn.SiLU,
    "softplus": nn.Softplus,
    "tanh": nn.Tanh,
}


@contextmanager
def one_thread() -> Iterator[None]:
    """Compute with one thread: the last bits of a product or decomposition depend on their number."""
    threads = torch.get_num_threads()
    torch.set_num_threads(1)
    try:
        yield
    finally:
        torch.set_num_threads(threads)


class Linear(nn.Linear):
    """`nn.Linear` that draws its weights from a given generator.

    With `gain=None` the initialisation is `nn.Linear`'s own, uniform in +-1/sqrt(in); otherwise orthogonal with that gain,
    with zero bias (Andrychowicz et al. 2021, "What matters in on-policy RL") or `nn.Linear`'s. Without a generator weights
    are zero, for a network whose weights are loaded or filled afterwards.
    """

    def __init__(
        self,
        in_features: int,
        out_features: int,
        generator: torch.Generator | None = None,
        *,
        gain: float | None = None,
        zero_bias: bool = True,
    ) -> None:
        self._generator, self._gain, self._zero_bias = generator, gain, zero_bias
        super().__init__(in_features, out_features)
        del self._generator  # nn.Module must stay copyable

    def reset_parameters(self) -> None:
        """Draw the weights; called once by `nn.Linear`'s constructor."""
        if self._generator is None:
            nn.init.zeros_(self.weight)
            nn.init.zeros_(self.bias)
            return
        bound = 1 / math.sqrt(self.in_features)
        if self._gain is None:
            nn.init.uniform_(self.weight, -bound, bound, generator=self._generator)
        else:
            with one_thread():
                nn.init.orthogonal_(self.weight, self._gain, generator=self._generator)
        if self._gain is None or not self._zero_bias:
            nn.init.uniform_(self.bias, -bound, bound, generator=self._generator)
        else:
            nn.init.zeros_(self.bias)


class ResidualLinear(nn.Module):
    """`x + Linear(x)` with zero weights: the identity until training moves it, `(B, n)` to `(B, n)`."""

    def __init__(self, features: int) -> None:
        super().__init__()
        self.linear = Linear(features, features)

    def forward(self, x: torch.Tensor) -> torch.Tensor:
        """Apply the layer."""
        return x + self.linear(x)


class MLP(nn.Sequential):
    """Linear layers, each followed by the activation, `(B, in)` to `(B, hidden[-1])`."""

    @property
    def activations(self) -> list[nn.Module]:
        """The activation modules, whose outputs `health` inspects."""
        return [module for module in self if type(module) in ACTIVATIONS.values()]


def mlp(
    in_features: int,
    hidden: Sequence[int],
    activation: str,
    generator: torch.Generator | None = None,
    *,
    gain: float | None = None,
    zero_bias: bool = True,
) -> MLP:
    """Make the hidden layers of an MLP, without an output layer."""
    sizes = [in_features, *hidden]
    layers: list[nn.Module] = []
    for fan_in, fan_out in itertools.pairwise(sizes):
        layers += [Linear(fan_in, fan_out, generator, gain=gain, zero_bias=zero_bias), ACTIVATIONS[activation]()]
    return MLP(*layers)
