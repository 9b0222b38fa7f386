"""Adam over parts with their own learning rates, on one flat buffer a part."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import cast

import torch
from torch import Tensor, nn
from torch.optim.adam import adam


@dataclass(frozen=True)
class Part:
    """Parameters that learn at one rate."""

    parameters: Sequence[nn.Parameter]
    lr_scale: float = 1.0
    clip_group: str = ""
    """Gradients of the parts of a group are clipped by their common norm."""


class PartAdam(torch.optim.Adam):
    """Adam (Kingma & Ba 2015) that keeps `lr * lr_scale` for every part, whatever is written into its groups' `lr`.

    The parameters of a part become views of one flat tensor, and so do their gradients: zeroing, clipping and the fused
    step are then one operation a part instead of several a tensor, which is most of their cost in a small network.
    """

    def __init__(self, parts: Sequence[Part], lr: float, *, max_grad_norm: float | None = None) -> None:
        self.parts, self.max_grad_norm = list(parts), max_grad_norm
        self.flat = [_flatten(part.parameters) for part in self.parts]
        super().__init__([{"params": [flat]} for flat in self.flat], lr=lr, fused=True)

    def zero_grad(self, set_to_none: bool = True) -> None:  # noqa: FBT001, FBT002 - torch's signature
        """Set every gradient to zero, always in place: the parameters' gradients are views."""
        for flat in self.flat:
            flat.grad.zero_()  # type: ignore[union-attr] - set by _flatten and never removed

    @torch.no_grad()
    def step(self, closure: None = None) -> None:  # type: ignore[override]
        """Clip the gradients, then update every part that is not frozen."""
        if self.max_grad_norm is not None:
            self._clip(self.max_grad_norm)
        for flat, group, part in zip(self.flat, self.param_groups, self.parts, strict=True):
            if not part.parameters[0].requires_grad:
                continue
            state = self.state[flat]
            if not state:
                state["step"] = torch.zeros((), device=flat.device)
                state["exp_avg"], state["exp_avg_sq"] = torch.zeros_like(flat), torch.zeros_like(flat)
            # The functional form skips what torch.optim.Adam does around it: a tenth of an update on small networks.
            adam(
                [flat],
                [cast("Tensor", flat.grad)],
                [state["exp_avg"]],
                [state["exp_avg_sq"]],
                [],
                [state["step"]],
                fused=True,
                amsgrad=False,
                beta1=group["betas"][0],
                beta2=group["betas"][1],
                lr=group["lr"] * part.lr_scale,
                weight_decay=0.0,
                eps=group["eps"],
                maximize=False,
            )

    def _clip(self, max_norm: float) -> None:
        """As `torch.nn.utils.clip_grad_norm_`, a group at a time."""
        for name in dict.fromkeys(part.clip_group for part in self.parts):
            grads = [flat.grad for flat, part in zip(self.flat, self.parts, strict=True) if part.clip_group == name]
            norms = [torch.linalg.vector_norm(grad) for grad in grads]  # type: ignore[arg-type] - set by _flatten
            norm = norms[0] if len(norms) == 1 else torch.linalg.vector_norm(torch.stack(norms))
            scale = (max_norm / (norm + 1e-6)).clamp(max=1.0)
            for grad in grads:
                grad.mul_(scale)  # type: ignore[union-attr]


def _flatten(parameters: Sequence[nn.Parameter]) -> Tensor:
    flat = torch.cat([parameter.detach().reshape(-1) for parameter in parameters]).requires_grad_()
    flat.grad = torch.zeros_like(flat)
    start = 0
    for parameter in parameters:
        rows = slice(start, start := start + parameter.numel())
        parameter.data = flat.data[rows].view_as(parameter)
        parameter.grad = flat.grad[rows].view_as(parameter)
    return flat
