"""The mirror images of transitions (Lin et al. 2020, invariant transform experience replay)."""

from __future__ import annotations

from typing import TYPE_CHECKING

import torch
from torch import Tensor

if TYPE_CHECKING:
    from transferkit.envs import Mirror


class Image:
    """Turns rows of the replay buffer into their images."""

    def __init__(self, mirror: Mirror, device: torch.device) -> None:
        observation, action = mirror.observation, mirror.action
        parts = (observation.index, action.index, (0,), observation.index, (0,))  # as `Batch.rows` has them
        starts = torch.tensor([0, *(len(part) for part in parts)]).cumsum(0).tolist()
        index = [start + k for start, part in zip(starts, parts, strict=False) for k in part]
        sign = (*observation.sign, *action.sign, 1.0, *observation.sign, 1.0)
        self._index, self._sign = torch.tensor(index, device=device), torch.tensor(sign, device=device)

    def of_half(self, rows: Tensor, generator: torch.Generator) -> Tensor:
        """Put images in place of a random half of the rows `(..., width)`."""
        half = torch.rand(rows.shape[:-1], generator=generator, device=rows.device) < 0.5
        return torch.where(half.unsqueeze(-1), rows[..., self._index] * self._sign, rows)
