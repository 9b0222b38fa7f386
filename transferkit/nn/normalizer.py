"""Observation statistics as part of the network, so that they are saved with the weights they belong to."""

from __future__ import annotations

from typing import Any

import torch
from torch import Tensor, nn

from transferkit.reading import FormatError

CLIP = 10.0
"""Standard deviations; as in OpenAI baselines' VecNormalize."""

EPSILON = 1e-8


class Normalizer(nn.Module):
    """Running mean and variance of everything seen (Chan et al. 1979), and `(x - mean) / std`, as a rule clipped to +-10."""

    mean: Tensor
    """`(dim,)`."""
    var: Tensor
    """`(dim,)`."""
    count: Tensor
    """Samples seen, scalar float64."""
    _inverse_std: Tensor

    def __init__(self, dim: int, *, clip: bool = True) -> None:
        super().__init__()
        self.clip = clip
        self.register_buffer("mean", torch.zeros(dim))
        self.register_buffer("var", torch.ones(dim))
        self.register_buffer("count", torch.zeros((), dtype=torch.float64))
        self.register_buffer("_inverse_std", torch.ones(dim), persistent=False)
        self.register_load_state_dict_post_hook(_refresh)
        self.refresh()

    def _apply(self, *args: Any, **kwargs: Any) -> Normalizer:  # noqa: ANN401 - torch's own
        """Move to a device: what follows is computed there, as it will be once the statistics are loaded again."""
        super()._apply(*args, **kwargs)
        self.refresh()
        return self

    def forward(self, x: Tensor) -> Tensor:
        """Normalise `x`, `(B, dim)`."""
        scaled = (x - self.mean).mul_(self._inverse_std)
        return scaled.clamp_(-CLIP, CLIP) if self.clip else scaled

    def inverse(self, normalized: Tensor) -> Tensor:
        """Undo `forward` without clipping, `(B, dim)`."""
        return normalized / self._inverse_std + self.mean

    @torch.no_grad()
    def update(self, x: Tensor) -> None:
        """Add the samples `(N, dim)` to the statistics."""
        n = x.shape[0]
        var, mean = torch.var_mean(x, dim=0, correction=0)
        total = self.count + n
        share = (n / total).float()
        delta = mean - self.mean
        # With no samples yet share is 1: the initial variance of 1 leaves no trace.
        self.var.copy_((1 - share) * self.var + share * var + share * (1 - share) * delta**2)
        self.mean.add_(share * delta)
        self.count.copy_(total)
        self.refresh()

    def refresh(self) -> None:
        """Recompute what follows from the variance."""
        self._inverse_std.copy_(torch.rsqrt(self.var + EPSILON))


class Shared:
    """A module that another one owns: called here, but registered, moved and saved with its owner only."""

    def __init__(self, module: nn.Module | None) -> None:
        self._module = module

    def __call__(self, x: Tensor) -> Tensor:
        """Apply the module; without one, return the input."""
        return x if self._module is None else self._module(x)


def _refresh(normalizer: Normalizer, _: object) -> None:
    """Follow statistics that were loaded, whoever wrote them."""
    if bool((normalizer.var < 0).any() or normalizer.count < 0):
        raise FormatError("a normaliser has a negative variance or count")
    normalizer.refresh()
