"""Settings of DYNA-PPO."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Annotated

from transferkit.config.checks import AT_LEAST_ONE, check


@dataclass(frozen=True)
class DynaPPOConfig:
    """PPO on imagined rollouts; the settings of PPO and of the model hold too."""

    rollouts: Annotated[int, AT_LEAST_ONE] = 64
    """Imagined rollouts side by side, in place of PPO's environments."""
    horizon: Annotated[int, AT_LEAST_ONE] = 16
    """Steps of an imagined rollout; the critic values what comes after it."""
    updates: Annotated[int, AT_LEAST_ONE] = 10
    """Rollouts and updates after each fit of the model."""
    buffer_size: Annotated[int, AT_LEAST_ONE] = 1_000_000
    """Transitions remembered, to which the model is fitted."""

    def __post_init__(self) -> None:
        check(self, "dyna_ppo")
