"""A module that learns, as a function of its flat weights, so that a whole update is one function of tensors."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING, Any

import torch
from torch import Tensor, nn
from torch.func import functional_call

from transferkit.nn.ensemble import EnsembleLinear
from transferkit.nn.optimizer import PartAdam

if TYPE_CHECKING:
    from transferkit.nn.optimizer import Part


class Learner:
    """A module, and Adam over its parts."""

    def __init__(self, module: nn.Module, parts: Sequence[Part], lr: float) -> None:
        self.module, self.optimizer = module, PartAdam(parts, lr)
        names = {id(parameter): name for name, parameter in module.named_parameters()}
        self._layout = [[(names[id(p)], p.shape) for p in part.parameters] for part in parts]
        projected = {id(m.weight) for m in module.modules() if isinstance(m, EnsembleLinear) and m.unit_norm}
        self._projected = [names[key] for key in names if key in projected]
        self.project()

    def weights(self) -> list[Tensor]:
        """Return the flat weights, one tensor a part, those that learn as leaves of a new graph."""
        learning = self.optimizer.learning
        return [flat.detach().requires_grad_(k in learning) for k, flat in enumerate(self.optimizer.flat)]

    def __call__(self, weights: Sequence[Tensor], *inputs: Tensor) -> Any:  # noqa: ANN401 - what the module returns
        """Call the module with these weights."""
        return functional_call(self.module, self._named(weights), inputs, tie_weights=False)

    def descend(self, loss: Tensor, weights: Sequence[Tensor], rates: Tensor) -> None:
        """Step down the gradient of the loss, if any part learns; `rates` are those of this step."""
        learning = [w for w in weights if w.requires_grad]
        if not learning:
            return
        grads = iter(torch.autograd.grad(loss, learning, materialize_grads=True))
        self.optimizer.apply([next(grads) if w.requires_grad else w for w in weights], rates)
        self.project()

    @torch.no_grad()
    def project(self) -> None:
        """Give the weights of every unit of the layers that ask for it a norm of one (Lee et al. 2025, "SimbaV2")."""
        if self._projected:
            named = self._named(self.optimizer.flat)
            for name in self._projected:
                weight = named[name]
                weight.div_(torch.linalg.vector_norm(weight, dim=-2, keepdim=True))

    def _named(self, weights: Sequence[Tensor]) -> dict[str, Tensor]:
        named: dict[str, Tensor] = {}
        for flat, layout in zip(weights, self._layout, strict=True):
            pieces = flat.split([shape.numel() for _, shape in layout])
            named |= {name: piece.view(shape) for piece, (name, shape) in zip(pieces, layout, strict=True)}
        return named
