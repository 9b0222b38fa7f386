"""Policies: a distribution over actions from raw observations, in parts that learn at their own rate."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import numpy as np
import torch
from numpy.typing import NDArray
from torch import Tensor, nn

from transferkit.errors import ConfigError, DimensionError, UnknownNameError
from transferkit.nn import Normalizer, PolicyNet, gaussian
from transferkit.table import format_table

if TYPE_CHECKING:
    from transferkit.nn import Architecture
    from transferkit.policy.core import Origin
    from transferkit.spec import IOSpec


@dataclass(frozen=True)
class ParameterGroup:
    """The parameters of one part and how they learn."""

    name: str
    parameters: list[nn.Parameter]
    lr_scale: float
    """Learning rate as a multiple of the trainer's."""
    frozen_share: float
    """Share of the budget during which the part does not learn."""


class Policy(nn.Module):
    """Raw observations `(B, obs_dim)` to the mean and log-std of a Gaussian over actions in [-1, 1], each `(B, act_dim)`.

    The observation normaliser is part of it. Subclasses name their `parts` and can be rebuilt from their `blueprint`.
    """

    obs_dim: int
    act_dim: int
    normalizer: Normalizer | None
    """Statistics of this environment's observations; None if the policy takes them raw."""
    has_core: bool = False
    """Whether a core acts in it from the first step."""
    origin: Origin | None = None
    """Where its core comes from, if it was wrapped and not loaded."""
    hold: int = 1
    """Control steps for which an action is held; whoever plays the policy asks it once in so many."""
    squash: bool = False
    """Whether the mean is bounded by tanh, as in the paper's DDPG."""
    lr_scale: Mapping[str, float]
    freeze: Mapping[str, float]

    def check_fits(self, needed: tuple[int, int], name: str) -> None:
        """Compare this policy's dimensions with the lengths of an environment's observation and action.

        Raises:
            ConfigError: they differ.
        """
        if (self.obs_dim, self.act_dim) != needed:
            raise ConfigError(
                f"the policy takes {self.obs_dim} observations and {self.act_dim} actions, environment {name} has "
                f"{needed[0]} and {needed[1]}",
                remedy="wrap a core onto that environment",
            )

    def forward(self, observation: Tensor) -> tuple[Tensor, Tensor]:
        """Compute mean and log-std of the action."""
        raise NotImplementedError

    def trace(self, observation: Tensor) -> dict[str, Tensor]:
        """Compute what enters and leaves the core, `core_input` and `core_output`, each `(B, ...)`; empty without a core."""
        return {}

    def trace_names(self) -> dict[str, list[str]]:
        """Name the elements of `trace`, in order."""
        return {}

    def normalized(self, observation: Tensor) -> Tensor:
        """Normalise the observation by the policy's statistics, if it has any."""
        return observation if self.normalizer is None else self.normalizer(observation)

    def parts(self) -> dict[str, nn.Module | nn.Parameter]:
        """Return the parts by name, from the observation to the action."""
        raise NotImplementedError

    def blueprint(self) -> dict[str, Any]:
        """Return JSON-ready data from which `transferkit.policy.blueprints.build` makes the same policy without its weights."""
        raise NotImplementedError

    def parameter_groups(self) -> list[ParameterGroup]:
        """Put every parameter into exactly one group, one group a part."""
        return [
            ParameterGroup(
                name,
                list(part.parameters()) if isinstance(part, nn.Module) else [part],
                self.lr_scale.get(name, 1.0),
                self.freeze.get(name, 0.0),
            )
            for name, part in self.parts().items()
        ]

    def at_progress(self, progress: float) -> None:
        """Freeze and unfreeze parts for a run that has used this share of its budget."""
        for group in self.parameter_groups():
            for parameter in group.parameters:
                parameter.requires_grad_(progress >= group.frozen_share)

    def update_normalizer(self, observation: Tensor) -> None:
        """Add observations `(N, obs_dim)` to the statistics."""
        if self.normalizer is not None:
            self.normalizer.update(observation)

    @torch.no_grad()
    def act(self, observation: NDArray[np.float32]) -> NDArray[np.float32]:
        """Choose the deterministic action `(B, act_dim)` for observations `(B, obs_dim)`.

        Raises:
            DimensionError: the observations are no numbers of this shape.
        """
        rows, device = np.asarray(observation), next(self.parameters()).device
        if rows.dtype.kind not in "fiub" or rows.shape[1:] != (self.obs_dim,):
            allowed = f"of shape (B, {self.obs_dim}) and of real numbers"
            raise DimensionError(f"observations of shape {rows.shape} and of {rows.dtype} must be {allowed}")
        return self(torch.from_numpy(rows.astype(np.float32, copy=False)).to(device))[0].cpu().numpy()

    def describe(self) -> str:
        """Describe the parts in a table: parameters, learning rate, what is frozen."""
        rows = []
        for group in self.parameter_groups():
            count = sum(parameter.numel() for parameter in group.parameters)
            frozen = f"{group.frozen_share:.0%} of the budget" if group.frozen_share else "-"
            rows.append((group.name, f"{count:,}", f"x {group.lr_scale:.3g}", frozen))
        return format_table(("part", "parameters", "learning rate", "frozen for"), rows)

    def _check_part_names(self) -> None:
        for option in ("freeze", "lr_scale"):
            for name in getattr(self, option):
                if name not in self.parts():
                    raise UnknownNameError(f"part in wrap.{option}", name, list(self.parts()))


def between(source: IOSpec, target: IOSpec) -> str:
    """What a core is wrapped onto, and where it comes from."""
    takes = f"{target.env_id}: {target.obs_dim} observations, {target.act_dim} actions"
    return f"{takes}\ncore from {source.env_id}: {source.obs_dim} inputs, {source.act_dim} actions"


class ScratchPolicy(Policy):
    """A plain network, for training without a core."""

    def __init__(self, network: PolicyNet, normalizer: Normalizer | None) -> None:
        super().__init__()
        self.obs_dim, self.act_dim = network.architecture.obs_dim, network.architecture.act_dim
        self.lr_scale, self.freeze = {}, {}
        self.squash = network.architecture.squash
        self.normalizer = normalizer
        self.network = network

    @classmethod
    def create(
        cls, architecture: Architecture, generator: torch.Generator | None, *, init_std: float, normalize: bool
    ) -> ScratchPolicy:
        """Make a new network and, if asked for, its normaliser."""
        network = PolicyNet(architecture, generator, init_std=init_std)
        return cls(network, Normalizer(architecture.obs_dim) if normalize else None)

    def forward(self, observation: Tensor) -> tuple[Tensor, Tensor]:
        """Compute mean and log-std of the action."""
        return self.network(self.normalized(observation))

    def parts(self) -> dict[str, nn.Module | nn.Parameter]:
        """Return one part, the network."""
        return {"network": self.network}

    def blueprint(self) -> dict[str, Any]:
        """Return the architecture, and whether observations are normalised."""
        return {
            "kind": "scratch",
            "architecture": self.network.architecture.to_json(),
            "normalize": self.normalizer is not None,
        }


class ConstantPolicy(Policy):
    """A Gaussian that does not look at the observation: a control that has a bias and a deviation alone."""

    def __init__(self, obs_dim: int, act_dim: int, *, init_std: float = 1.0) -> None:
        super().__init__()
        self.obs_dim, self.act_dim, self.normalizer = obs_dim, act_dim, None
        self.lr_scale, self.freeze = {}, {}
        self.bias = nn.Parameter(torch.zeros(act_dim))
        self.log_std = nn.Parameter(torch.full((act_dim,), math.log(init_std)))

    def forward(self, observation: Tensor) -> tuple[Tensor, Tensor]:
        """Return the same mean and log-std for every row."""
        rows = (len(observation), self.act_dim)
        return self.bias.expand(rows), self.log_std.clamp(*gaussian.LOG_STD_BOUNDS).expand(rows)

    def parts(self) -> dict[str, nn.Module | nn.Parameter]:
        """Return both parameters."""
        return {"bias": self.bias, "log_std": self.log_std}

    def blueprint(self) -> dict[str, Any]:
        """Return its dimensions."""
        return {"kind": "constant", "obs_dim": self.obs_dim, "act_dim": self.act_dim}
