"""How a student learns from labelled observations."""

from __future__ import annotations

from typing import TYPE_CHECKING

import torch
from torch import Tensor

if TYPE_CHECKING:
    from transferkit.policy.base import ScratchPolicy


def imitation_loss(mean: Tensor, wanted: Tensor) -> Tensor:
    """Mean squared difference of actions `(B, act_dim)`, in halves of their ranges.

    Where the teacher goes to a limit, what goes beyond it is no error: the environment clips. Ross, Gordon & Bagnell 2011
    (DAgger) with the squared loss.
    """
    beyond = (wanted.abs() >= 1) & (mean * wanted.sign() >= 1)
    return ((mean - wanted) * ~beyond).square().mean()


def learn(
    student: ScratchPolicy,
    observation: Tensor,
    wanted: Tensor,
    *,
    passes: int,
    batch: int,
    lr: float,
    generator: torch.Generator,
    anneal: bool = False,
) -> float:
    """Train on observations `(N, obs_dim)` and the teacher's actions `(N, act_dim)`; returns the last pass's mean loss."""
    optimizer = torch.optim.Adam(student.parameters(), lr)
    loss_of_pass = 0.0
    for k in range(passes):
        losses = []
        for rows in torch.randperm(len(observation), generator=generator).split(batch):
            loss = imitation_loss(student(observation[rows])[0], wanted[rows])
            optimizer.zero_grad()
            loss.backward()
            optimizer.step()
            losses.append(loss.detach())
        loss_of_pass = float(torch.stack(losses).mean())
        if anneal:
            optimizer.param_groups[0]["lr"] = lr * (1 - (k + 1) / passes)
    return loss_of_pass
