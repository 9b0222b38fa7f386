"""What there is to see at one moment, and what a policy sees of it."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import TYPE_CHECKING

import gymnasium
import numpy as np
import torch
from numpy.typing import NDArray

if TYPE_CHECKING:
    from transferkit.policy.base import Policy
    from transferkit.spec import IOSpec


@dataclass(frozen=True)
class Moment:
    """An environment before a step, or at the end of an episode."""

    env: gymnasium.Env
    observation: NDArray[np.float32]
    """`(obs_dim,)`."""
    step: int
    """Of the episode, from 0."""
    seconds: float
    """Simulated, since the episode began."""
    last: bool
    """Whether the episode is over."""


Show = Callable[[Moment], bool]
"""Shows a moment; False ends the play, because nobody watches any more."""


@dataclass(frozen=True)
class Inputs:
    """What enters the core; of a policy without adapters, the observation."""

    names: list[str]
    of_core: bool
    """Whether a core stands behind adapters."""
    policy: Policy

    @property
    def title(self) -> str:
        """What the numbers are."""
        return "core input" if self.of_core else "observation"

    @torch.no_grad()
    def at(self, moment: Moment) -> NDArray[np.float32]:
        """Compute them, `(len(names),)`."""
        if not self.of_core:
            return moment.observation
        return self.policy.trace(torch.from_numpy(moment.observation[None]))["core_input"][0].numpy()


def inputs_of(policy: Policy, spec: IOSpec) -> Inputs:
    """Find what a policy's core sees in an environment, and the names of it."""
    names = policy.trace_names().get("core_input")
    observation = [element.name for element in spec.observation]
    return Inputs(observation if names is None else list(names), names is not None, policy)
