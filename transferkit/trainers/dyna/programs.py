"""The functions in which DYNA-DDPG spends its time, compiled or as they are."""

from __future__ import annotations

from collections.abc import Callable
from typing import TYPE_CHECKING, Any, NamedTuple

import torch
from torch import Tensor

from transferkit.nn.captured import Captured
from transferkit.nn.compiled import compiled
from transferkit.trainers.dyna.fit import update_model
from transferkit.trainers.dyna.imagine import imagined_step
from transferkit.trainers.dyna.losses import td_target
from transferkit.trainers.dyna.updates import update

if TYPE_CHECKING:
    from transferkit.trainers.dyna.replay import Batch


class Programs(NamedTuple):
    """Each field is the function of its name."""

    td_target: Callable[..., Tensor]
    update: Callable[..., tuple[Tensor, Tensor]]
    update_model: Callable[..., Tensor]
    imagined_step: Callable[..., tuple[Batch, Tensor]]


def programs(device: torch.device, *, compiles: bool) -> Programs:
    """Return them as they are, or to be compiled when they are first called; on a CUDA device, to be captured."""
    functions: tuple[Any, ...] = (td_target, update, update_model, imagined_step)
    if not compiles:
        return Programs(*functions)
    return Programs(*map(Captured if device.type == "cuda" else compiled, functions))
