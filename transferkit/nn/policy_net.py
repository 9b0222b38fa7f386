"""The policy network that is trained from scratch, and that becomes a core when it is good."""

from __future__ import annotations

import itertools
import math
from dataclasses import asdict, dataclass
from typing import Any, Literal

import torch
from torch import Tensor, nn

from transferkit.nn.gaussian import LOG_STD_BOUNDS
from transferkit.nn.layers import Linear, mlp
from transferkit.reading import Layers, Size

Activation = Literal["tanh", "relu", "elu", "gelu", "leaky_relu", "mish", "selu", "sigmoid", "silu", "softplus"]

GAINS = {"orthogonal": (math.sqrt(2), 0.01), "uniform": (None, None), "paper": (math.sqrt(2), 0.1)}
"""Gains of the hidden layers and of the heads, by initialisation; None keeps `nn.Linear`'s own."""


@dataclass(frozen=True)
class Architecture:
    """Everything needed to rebuild a `PolicyNet` before its weights are loaded."""

    obs_dim: Size
    act_dim: Size
    hidden: Layers = (64, 64)
    activation: Activation = "tanh"
    std: Literal["parameter", "head"] = "parameter"
    """`parameter`: one bounded log-std per action. `head`: a linear head on the features, unbounded, as in the paper."""
    initialization: Literal["orthogonal", "uniform", "paper"] = "orthogonal"
    """`orthogonal` with small heads, `uniform` as `nn.Linear` has it, or `paper`: orthogonal with heads of 0.1."""
    squash: bool = False
    """Bound the mean by tanh, as in the paper's DDPG."""

    def to_json(self) -> dict[str, Any]:
        """Return JSON-ready data."""
        return asdict(self)

    @property
    def feature_dim(self) -> int:
        """Width of the last hidden layer."""
        return self.hidden[-1]

    @property
    def weights(self) -> int:
        """Numbers in its matrices, known before any is allocated."""
        return sum(a * b for a, b in itertools.pairwise((self.obs_dim, *self.hidden, self.act_dim)))


class PolicyNet(nn.Module):
    """Observations `(B, obs_dim)` to the mean and log-std of a Gaussian over actions, both `(B, act_dim)`.

    `body` makes the features, `(B, hidden[-1])`; `mean_head` and the log-std make the action of them.
    """

    def __init__(self, architecture: Architecture, generator: torch.Generator | None = None, *, init_std: float = 1.0) -> None:
        """Initialise from the generator, or with zeros when the weights are loaded afterwards.

        Orthogonal with gain sqrt(2), and 0.01 on the mean head so that a new policy acts near zero (Andrychowicz et al.
        2021). `paper` has 0.1 on both heads and biases as `nn.Linear` has them, as in the paper's code; `uniform` keeps
        `nn.Linear`'s own initialisation.
        """
        super().__init__()
        self.architecture = architecture
        gain, head_gain = GAINS[architecture.initialization]
        zero_bias = architecture.initialization != "paper"
        hidden, width = architecture.hidden, architecture.hidden[-1]
        self.body = mlp(architecture.obs_dim, hidden, architecture.activation, generator, gain=gain, zero_bias=zero_bias)
        self.mean_head = Linear(width, architecture.act_dim, generator, gain=head_gain, zero_bias=zero_bias)
        if architecture.std == "head":
            self.log_std_head = Linear(width, architecture.act_dim, generator, gain=head_gain, zero_bias=zero_bias)
        else:
            self.log_std = nn.Parameter(torch.full((architecture.act_dim,), math.log(init_std)))

    @property
    def feature_dim(self) -> int:
        """Width of the last hidden layer."""
        return self.architecture.feature_dim

    def features(self, x: Tensor) -> Tensor:
        """Compute the last hidden layer, `(B, feature_dim)`."""
        return self.body(x)

    def action_distribution(self, features: Tensor) -> tuple[Tensor, Tensor]:
        """Compute mean and log-std, each `(B, act_dim)`, from the features."""
        mean = self.mean_head(features)
        if self.architecture.squash:
            mean = torch.tanh(mean)
        if self.architecture.std == "head":
            return mean, self.log_std_head(features)
        return mean, self.log_std.clamp(*LOG_STD_BOUNDS).expand_as(mean)

    def forward(self, x: Tensor) -> tuple[Tensor, Tensor]:
        """Compute mean and log-std, each `(B, act_dim)`, from (normalised) observations."""
        return self.action_distribution(self.features(x))
