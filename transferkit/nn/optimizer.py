"""Adam over parts with their own learning rates, on one flat tensor a part, as plain tensor operations."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from itertools import chain
from typing import Any

import numpy as np
import torch
from torch import Tensor, nn

BETAS, EPSILON = (0.9, 0.999), 1e-8
"""torch.optim.Adam's defaults."""


@dataclass(frozen=True)
class Part:
    """Parameters that learn at one rate."""

    parameters: Sequence[nn.Parameter]
    lr_scale: float = 1.0
    lr: float | None = None
    """Learning rate of its own, unscaled, whatever is written into the groups' `lr`."""


class PartAdam:
    """Adam (Kingma & Ba 2015) that keeps `lr * lr_scale`, or its own `lr`, for every part, whatever its groups' `lr` becomes.

    The parameters of a part become views of one flat tensor, so that a step is a few operations a part instead of several a
    tensor. It is tensor operations alone, so that a whole update can be compiled: what depends on the number of steps, `rates`,
    is computed beforehand.
    """

    def __init__(self, parts: Sequence[Part], lr: float) -> None:
        self.parts = list(parts)
        self.flat = [flatten(part.parameters) for part in self.parts]
        self.param_groups: list[dict[str, Any]] = [{"params": [flat], "lr": lr} for flat in self.flat]
        self.moments = [(torch.zeros_like(flat), torch.zeros_like(flat)) for flat in self.flat]
        self._steps = [0 for _ in self.flat]

    @property
    def learning(self) -> list[int]:
        """The parts that are not frozen."""
        return [k for k, part in enumerate(self.parts) if part.parameters[0].requires_grad]

    def rates(self, n: int, lr: float | None = None) -> Tensor:
        """Count the next `n` steps of the learning parts; returns their step sizes and second moments' scales, `(n, parts, 2)`.

        They are Adam's learning rate, `lr` if it is given in place of the groups', over its first bias correction, and one over
        the root of its second.
        """
        rates = np.zeros((n, len(self.parts), 2))
        for k in self.learning:
            part, first = self.parts[k], self._steps[k] + 1
            base = self.param_groups[k]["lr"] if lr is None else lr
            size = base * part.lr_scale if part.lr is None else part.lr
            steps = np.arange(first, first + n)
            rates[:, k, 0], rates[:, k, 1] = size / (1 - BETAS[0] ** steps), (1 - BETAS[1] ** steps) ** -0.5
            self._steps[k] += n
        return torch.from_numpy(rates.astype(np.float32)).to(self.flat[0].device)

    @torch.no_grad()
    def apply(self, grads: Sequence[Tensor], rates: Tensor, lr: Tensor | float = 1.0) -> None:
        """Update the learning parts by flat gradients, one for each part, at the `rates` `(parts, 2)` of this step.

        The step size of a part without a rate of its own is multiplied by `lr`.
        """
        for k in self.learning:
            first, second = self.moments[k]
            first.lerp_(grads[k], 1 - BETAS[0])
            second.mul_(BETAS[1]).addcmul_(grads[k], grads[k], value=1 - BETAS[1])
            size = rates[k, 0] * lr if self.parts[k].lr is None else rates[k, 0]
            self.flat[k].sub_(size * first / (second.sqrt() * rates[k, 1] + EPSILON))

    def forget(self) -> None:
        """Start as if no step had been taken."""
        for moment in chain(*self.moments):
            moment.zero_()
        self._steps = [0 for _ in self.flat]

    def state_dict(self) -> dict[str, Any]:
        """Return moments, steps and learning rates."""
        return {
            "moments": [list(pair) for pair in self.moments],
            "steps": [torch.tensor(float(steps)) for steps in self._steps],
            "lr": [group["lr"] for group in self.param_groups],
        }

    def load_state_dict(self, state: dict[str, Any]) -> None:
        """Take what `state_dict` returned."""
        for own, saved in zip(self.moments, state["moments"], strict=True):
            for tensor, value in zip(own, saved, strict=True):
                tensor.copy_(value)
        self._steps = [int(steps) for steps in state["steps"]]
        for group, lr in zip(self.param_groups, state["lr"], strict=True):
            group["lr"] = lr


def flatten(parameters: Sequence[nn.Parameter]) -> Tensor:
    """Make one flat tensor, of which the parameters become views."""
    flat = torch.cat([parameter.detach().reshape(-1) for parameter in parameters])
    start = 0
    for parameter in parameters:
        rows = slice(start, start := start + parameter.numel())
        parameter.data = flat[rows].view_as(parameter)
    return flat
