"""A core's ensemble between new layers, and how critics and models that may hold one learn."""

from __future__ import annotations

from typing import TYPE_CHECKING

import torch
from torch import Tensor, nn

from transferkit.nn import EnsembleLinear, Part

if TYPE_CHECKING:
    from transferkit.nn import Ensemble
    from transferkit.policy.base import Policy
    from transferkit.policy.core import Origin


class WrappedEnsemble(nn.Module):
    """Hidden layers of a core's ensemble, a residual layer that starts as the identity, and a head; beside them a new ensemble.

    The core sees no more of the target than its own source had. What the values and the changes of a larger robot depend on
    besides, only a path around the core can learn (as the columns of Rusu et al. 2016).
    """

    def __init__(self, core: Ensemble, new: Ensemble, origin: Origin | None, generator: torch.Generator) -> None:
        """Take the core's own head if the origin's adapters are matched, else a random one; `new` starts at zero."""
        super().__init__()
        members, width = core.architecture.members, core.architecture.hidden[-1]
        self.core, self.new = core, new
        self.finetune = EnsembleLinear(members, width, width)
        matched = origin is not None and origin.match is not None
        own = core.take_head()
        self.head = own if matched else EnsembleLinear(members, width, new.architecture.out_dim, generator)
        new.zero_head()

    def forward(self, x: Tensor) -> Tensor:
        """Compute outputs `(E, B, out_dim)` of inputs `(B, in_dim)`, or `(E, B, in_dim)` for rows of its own each."""
        adapted, direct = x.split((self.core.architecture.in_dim, self.new.architecture.in_dim), -1)
        features = self.core.features(adapted)
        return self.head(features + self.finetune(features)) + self.new(direct)

    def core_parameters(self) -> list[nn.Parameter]:
        """Return the parameters of the hidden layers, with their scales."""
        return list(self.core.parameters())


def learning_parts(module: nn.Module, policy: Policy) -> list[Part]:
    """Collect all parameters of a critic or a model; those of a wrapped core learn at the rate of the policy's core."""
    core = [p for child in module.modules() if isinstance(child, WrappedEnsemble) for p in child.core_parameters()]
    known = {id(p) for p in core}
    parts = [Part([p for p in module.parameters() if id(p) not in known])]
    return [*parts, Part(core, policy.lr_scale.get("core", 1.0))] if core else parts


def thaw(module: nn.Module, policy: Policy, progress: float) -> None:
    """Let everything learn, but a wrapped core only when the policy's core may."""
    module.requires_grad_(requires_grad=True)
    if progress < policy.freeze.get("core", 0.0):
        for child in module.modules():
            if isinstance(child, WrappedEnsemble):
                child.core.requires_grad_(requires_grad=False)
