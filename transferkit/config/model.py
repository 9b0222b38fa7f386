"""Settings of the learnt model of the environment."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Annotated, Literal

from transferkit.config.checks import AT_LEAST_ONE, RATE, check


@dataclass(frozen=True)
class ModelConfig:
    """An ensemble that predicts observations, rewards and terminations (Chua et al. 2018), for DYNA-DDPG and DYNA-PPO."""

    members: Annotated[int, AT_LEAST_ONE] = 5
    """Networks of the ensemble."""
    hidden: tuple[Annotated[int, AT_LEAST_ONE], ...] = (128, 128)
    """Hidden layers of each."""
    layer_norm: bool = True
    """Normalise the hidden layers."""
    learning_rate: Annotated[float, RATE] = 1e-3
    """Adam step size."""
    every: Annotated[int, AT_LEAST_ONE] = 250
    """Environment steps between fits (Janner et al. 2019)."""
    updates: Annotated[int, AT_LEAST_ONE] = 250
    """Most batches per fit."""
    batch_size: Annotated[int, AT_LEAST_ONE] = 256
    """Transitions per batch and member."""
    loss: Literal["likelihood", "squared-error"] = "likelihood"
    """Gaussian with learnt variance, reward and termination; or the next observation alone (the paper)."""
    predict: Literal["change", "state"] = "change"
    """Predict the change of the observation, or the next observation itself (the paper)."""
    normalize_targets: bool = True
    """Predict in units of the targets' own deviations."""

    def __post_init__(self) -> None:
        check(self, "model")
