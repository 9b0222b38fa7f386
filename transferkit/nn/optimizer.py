"""Adam over parts with their own learning rates, on one flat buffer a part."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import torch
from torch import Tensor, nn

BETAS, EPSILON = (0.9, 0.999), 1e-8
"""torch.optim.Adam's defaults."""


@dataclass(frozen=True)
class Part:
    """Parameters that learn at one rate."""

    parameters: Sequence[nn.Parameter]
    lr_scale: float = 1.0
    clip_group: str = ""
    """Gradients of the parts of a group are clipped by their common norm."""
    lr: float | None = None
    """Learning rate of its own, unscaled, whatever is written into the groups' `lr`."""


class PartAdam:
    """Adam (Kingma & Ba 2015) that keeps `lr * lr_scale`, or its own `lr`, for every part, whatever its groups' `lr` becomes.

    The parameters of a part become views of one flat tensor, and so do their gradients: zeroing, clipping and the step
    are then one operation a part instead of several a tensor. It calls torch's fused kernel itself, because what
    `torch.optim.Adam` does around that takes several times as long on small networks (`make bench`).
    """

    def __init__(self, parts: Sequence[Part], lr: float, *, max_grad_norm: float | None = None) -> None:
        self.parts, self.max_grad_norm = list(parts), max_grad_norm
        self.flat = [flatten(part.parameters) for part in self.parts]
        self._grads = [_gradient(flat) for flat in self.flat]
        self.param_groups: list[dict[str, Any]] = [{"params": [flat], "lr": lr} for flat in self.flat]
        self._moments = [(torch.zeros_like(flat), torch.zeros_like(flat)) for flat in self.flat]
        self._steps = [torch.zeros((), device=flat.device) for flat in self.flat]
        self._clip_groups = [
            [k for k, part in enumerate(self.parts) if part.clip_group == name]
            for name in dict.fromkeys(part.clip_group for part in self.parts)
        ]

    def zero_grad(self) -> None:
        """Set every gradient to zero, in place: the parameters' gradients are views."""
        for grad in self._grads:
            grad.zero_()

    @torch.no_grad()
    def step(self) -> None:
        """Clip the gradients, and update every part that is not frozen."""
        for group in self._clip_groups:
            scale = None if self.max_grad_norm is None else self._grad_scale(group, self.max_grad_norm)
            for k in group:
                if self.parts[k].parameters[0].requires_grad:
                    self._update(k, scale)

    def state_dict(self) -> dict[str, Any]:
        """Return moments, steps and learning rates."""
        return {
            "moments": [list(pair) for pair in self._moments],
            "steps": list(self._steps),
            "lr": [group["lr"] for group in self.param_groups],
        }

    def load_state_dict(self, state: dict[str, Any]) -> None:
        """Take what `state_dict` returned."""
        for own, saved in zip(self._moments, state["moments"], strict=True):
            for tensor, value in zip(own, saved, strict=True):
                tensor.copy_(value)
        for step, value in zip(self._steps, state["steps"], strict=True):
            step.copy_(value)
        for group, lr in zip(self.param_groups, state["lr"], strict=True):
            group["lr"] = lr

    def _grad_scale(self, group: Sequence[int], max_norm: float) -> Tensor:
        """Compute what the fused kernel divides the group's gradients by; as `torch.nn.utils.clip_grad_norm_`."""
        norms = [torch.linalg.vector_norm(self._grads[k]) for k in group]
        norm = norms[0] if len(norms) == 1 else torch.linalg.vector_norm(torch.stack(norms))
        return (norm / max_norm).clamp(min=1.0)

    def _update(self, k: int, scale: Tensor | None) -> None:
        flat, (first, second), step, part = self.flat[k], self._moments[k], self._steps[k], self.parts[k]
        step += 1
        torch._fused_adam_(
            [flat],
            [self._grads[k]],
            [first],
            [second],
            [],
            [step],
            lr=self.param_groups[k]["lr"] * part.lr_scale if part.lr is None else part.lr,
            beta1=BETAS[0],
            beta2=BETAS[1],
            weight_decay=0.0,
            eps=EPSILON,
            amsgrad=False,
            maximize=False,
            grad_scale=scale,
            found_inf=None,
        )


def _gradient(flat: Tensor) -> Tensor:
    """Return the gradient that `flatten` has set and nobody removes."""
    assert flat.grad is not None
    return flat.grad


def flatten(parameters: Sequence[nn.Parameter]) -> Tensor:
    """Make one flat tensor, of which the parameters, and of whose gradient their gradients, become views."""
    flat = torch.cat([parameter.detach().reshape(-1) for parameter in parameters]).requires_grad_()
    flat.grad = torch.zeros_like(flat)
    start = 0
    for parameter in parameters:
        rows = slice(start, start := start + parameter.numel())
        parameter.data = flat.data[rows].view_as(parameter)
        parameter.grad = flat.grad[rows].view_as(parameter)
    return flat
