"""A policy that was trained around a core, as the network of a core itself."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any, Literal

from torch import Tensor, nn

if TYPE_CHECKING:
    from transferkit.nn import Linear
    from transferkit.policy.paper import PaperSandwich
    from transferkit.policy.sandwich import Sandwich


@dataclass(frozen=True)
class Composed:
    """Everything needed to rebuild a `ComposedNet` before its weights are loaded; the counterpart of `Architecture`."""

    blueprint: Mapping[str, Any]
    """Of its policy, which holds that of the policy's own core."""
    obs_dim: int
    act_dim: int
    std: Literal["parameter", "head"]
    squash: bool

    def to_json(self) -> dict[str, Any]:
        """Return the blueprint."""
        return dict(self.blueprint)


class ComposedNet(nn.Module):
    """A whole policy with the face of a `PolicyNet`: it takes normalised observations, and undoes that.

    The policy knows its own environment by raw observations, and keeps its statistics as they are; it clips what it normalises
    itself, so that before it nothing is clipped. Its features are all that its mean action is a linear map of: what its core
    makes, and what its way around the core makes.
    """

    def __init__(self, policy: Sandwich | PaperSandwich) -> None:
        super().__init__()
        self.policy = policy
        std: Literal["parameter", "head"] = "parameter" if "log_std" in policy.parts() else "head"
        self.architecture = Composed(policy.blueprint(), policy.obs_dim, policy.act_dim, std, policy.squash)

    @property
    def feature_dim(self) -> int:
        """Width of the features."""
        return self.mean_head.in_features

    @property
    def mean_head(self) -> Linear:
        """The linear map from the features to the mean action; a copy."""
        return self.policy.head()

    @property
    def log_std(self) -> nn.Parameter:
        """The log-std of a policy that has one for each action."""
        parameter = self.policy.parts()["log_std"]
        assert isinstance(parameter, nn.Parameter)
        return parameter

    def features(self, x: Tensor) -> Tensor:
        """Compute the features, `(B, feature_dim)`."""
        normalizer = self.policy.normalizer
        return self.policy.features(x if normalizer is None else normalizer.inverse(x))

    def action_distribution(self, features: Tensor) -> tuple[Tensor, Tensor]:
        """Compute mean and log-std, each `(B, act_dim)`, from the features."""
        return self.policy.distribution(features)

    def forward(self, x: Tensor) -> tuple[Tensor, Tensor]:
        """Compute mean and log-std, each `(B, act_dim)`, from normalised observations."""
        return self.action_distribution(self.features(x))
