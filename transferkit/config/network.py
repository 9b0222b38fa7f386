"""Settings of the network that is trained from scratch."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Annotated, Literal

from transferkit.config.checks import POSITIVE, Hidden, check

Activation = Literal["tanh", "relu", "elu"]


@dataclass(frozen=True)
class NetworkConfig:
    """A policy network without a core; critics take its hidden layers too."""

    hidden: Hidden = (64, 64)
    """Hidden layers of the policy that is trained from scratch, and of the critics."""
    activation: Activation = "tanh"
    """Activation of the policy and of PPO's critic; other critics and models take rectified units."""
    std: Literal["parameter", "head"] = "parameter"
    """One bounded log-std per action, or a linear head on the features (the paper)."""
    init_std: Annotated[float, POSITIVE] = 0.6
    """Initial standard deviation of actions, of a range of [-1, 1]."""
    initialization: Literal["orthogonal", "uniform", "paper"] = "orthogonal"
    """Orthogonal with small heads, `nn.Linear`'s own (the paper's DDPG), or orthogonal with heads of 0.1 (the paper's PPO)."""
    squash: bool = False
    """Bound the policy's mean by tanh (the paper's DDPG)."""
    normalize_observation: bool = True
    """Keep a running mean and variance of observations inside the policy."""

    def __post_init__(self) -> None:
        check(self, "network")
