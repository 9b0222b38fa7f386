"""Several MLPs computed as one: every tensor has a leading axis over members."""

from __future__ import annotations

import itertools
import math
from dataclasses import asdict, dataclass
from typing import Any

import torch
from torch import Tensor, nn
from torch.nn import functional

from transferkit.reading import Layers, Size


@dataclass(frozen=True)
class EnsembleArchitecture:
    """Everything needed to rebuild an ensemble before its weights are loaded."""

    members: Size
    in_dim: Size
    out_dim: Size
    hidden: Layers
    layer_norm: bool = True
    """Normalise before every ReLU (Ba et al. 2016), with a learnt scale only if weights have unit norm."""
    unit_norm: bool = False
    """Keep the weights of every hidden unit at a norm of one; layers have a learnt scale instead (Lee et al. 2025)."""

    def to_json(self) -> dict[str, Any]:
        """Return JSON-ready data."""
        return asdict(self)

    @property
    def weights(self) -> int:
        """Numbers in its matrices, known before any is allocated."""
        sizes = itertools.pairwise((self.in_dim, *self.hidden, self.out_dim))
        return self.members * sum(a * b for a, b in sizes)


class EnsembleLinear(nn.Module):
    """`(E, B, in)` to `(E, B, out)`; weights as `nn.Linear` draws them, or zero without a generator."""

    def __init__(
        self,
        members: int,
        in_features: int,
        out_features: int,
        generator: torch.Generator | None = None,
        *,
        unit_norm: bool = False,
    ) -> None:
        super().__init__()
        self.unit_norm = unit_norm
        bound = 1 / math.sqrt(in_features)
        self.weight = nn.Parameter(torch.zeros(members, in_features, out_features))
        self.bias = nn.Parameter(torch.zeros(members, 1, out_features))
        if generator is not None:
            nn.init.uniform_(self.weight, -bound, bound, generator=generator)
            nn.init.uniform_(self.bias, -bound, bound, generator=generator)

    def forward(self, x: Tensor) -> Tensor:
        """Apply each member to its own rows, or to the same rows `(B, in)`."""
        x = x if x.dim() == 3 else x.expand(len(self.weight), *x.shape)
        if self.weight.shape[-1] == 1:  # a product with one column takes three times as long as this
            return (x * self.weight.transpose(1, 2)).sum(-1, keepdim=True) + self.bias
        return torch.bmm(x, self.weight).add_(self.bias)  # `baddbmm` copies the bias first


class Ensemble(nn.Module):
    """Hidden layers (`features`) and a linear head for each member."""

    def __init__(self, architecture: EnsembleArchitecture, generator: torch.Generator | None = None) -> None:
        super().__init__()
        self.architecture = architecture
        sizes = [architecture.in_dim, *architecture.hidden]
        pairs = itertools.pairwise(sizes)
        members, unit_norm = architecture.members, architecture.unit_norm
        self.body = nn.ModuleList(EnsembleLinear(members, a, b, generator, unit_norm=unit_norm) for a, b in pairs)
        scales = [nn.Parameter(torch.ones(members, 1, width)) for width in architecture.hidden if unit_norm]
        self.scales = nn.ParameterList(scales)
        self.head: EnsembleLinear | nn.Identity
        self.head = EnsembleLinear(architecture.members, sizes[-1], architecture.out_dim, generator)

    def features(self, x: Tensor) -> Tensor:
        """Compute the last hidden layer `(E, B, hidden[-1])` of inputs `(B, in_dim)`, or `(E, B, in_dim)` for own rows each."""
        for k, layer in enumerate(self.body):
            x = layer(x)
            x = functional.layer_norm(x, x.shape[-1:]) if self.architecture.layer_norm else x
            x = torch.relu_(x * self.scales[k] if self.architecture.unit_norm else x)
        return x

    def forward(self, x: Tensor) -> Tensor:
        """Compute outputs, `(E, B, out_dim)`."""
        return self.head(self.features(x))

    def zero_head(self) -> None:
        """Make every output zero until training moves it."""
        for parameter in self.head.parameters():
            nn.init.zeros_(parameter)

    def take_head(self) -> EnsembleLinear | nn.Identity:
        """Hand the head to another module; what stays ends in its features."""
        head, self.head = self.head, nn.Identity()
        return head
