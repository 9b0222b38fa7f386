"""The paper's sandwich with its ReLUs and its shared output layer, only for reproducing the paper."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import torch
from torch import Tensor, nn

from transferkit.nn import Linear
from transferkit.policy.base import Policy, between

if TYPE_CHECKING:
    from transferkit.config import WrapConfig
    from transferkit.nn import PolicyNet
    from transferkit.policy.composed import ComposedNet
    from transferkit.policy.core import Origin
    from transferkit.spec import IOSpec

EPSILON = 1e-6
"""Added to the standard deviation before its logarithm."""


class PaperSandwich(Policy):
    """`Linear(n, d) -> Linear(d, d) -> ReLU -> core -> Linear(a, a) -> ReLU -> Linear(a, k)` on raw observations.

    Mean and standard deviation of the core pass through the *same* output fine-tune layer, then through a linear layer
    each; log std = Linear(log(std + 1e-6)), unbounded.
    """

    has_core = True

    def __init__(
        self,
        core: PolicyNet | ComposedNet,
        specs: tuple[IOSpec, IOSpec],
        config: WrapConfig,
        generators: dict[str, torch.Generator] | None,
        *,
        origin: Origin | None = None,
    ) -> None:
        super().__init__()
        source, target = specs
        generators = generators or {}
        self._specs, self.config, self.origin = specs, config, origin
        self.obs_dim, self.act_dim = target.obs_dim, target.act_dim
        self.lr_scale, self.freeze = dict(config.lr_scale), dict(config.freeze)
        self.normalizer = None
        inwards, outwards = generators.get("input_adapter"), generators.get("output_adapter")
        self.input_adapter = Linear(target.obs_dim, source.obs_dim, inwards)
        self.input_finetune = Linear(source.obs_dim, source.obs_dim, inwards)
        self.core = core
        self.output_finetune = Linear(source.act_dim, source.act_dim, outwards)
        self.mean_adapter = Linear(source.act_dim, target.act_dim, outwards)
        self.std_adapter = Linear(source.act_dim, target.act_dim, outwards)
        self._check_part_names()

    def core_input(self, observation: Tensor) -> Tensor:
        """Compute what the core sees, `(B, d_source)`; never negative."""
        return torch.relu(self.input_finetune(self.input_adapter(observation)))

    def forward(self, observation: Tensor) -> tuple[Tensor, Tensor]:
        """Compute mean and log-std of the action."""
        return self._adapted(*self._finetuned(observation))

    def features(self, observation: Tensor) -> Tensor:
        """Compute all that mean and log-std are made of, for a sandwich around this one to take."""
        return torch.cat(self._finetuned(observation), -1)

    def head(self) -> Linear:
        """Copy the linear map from `features` to the mean action."""
        head = Linear(2 * self.mean_adapter.in_features, self.act_dim)
        with torch.no_grad():
            head.weight[:, : self.mean_adapter.in_features].copy_(self.mean_adapter.weight)
            head.bias.copy_(self.mean_adapter.bias)
        return head

    def distribution(self, features: Tensor) -> tuple[Tensor, Tensor]:
        """Compute mean and log-std of the action from `features`."""
        return self._adapted(*features.chunk(2, -1))

    @property
    def target(self) -> IOSpec:
        """Meaning of the observation and the action."""
        return self._specs[1]

    def _finetuned(self, observation: Tensor) -> tuple[Tensor, Tensor]:
        core_mean, core_log_std = self.core(self.core_input(observation))
        return torch.relu(self.output_finetune(core_mean)), torch.relu(self.output_finetune(core_log_std.exp()))

    def _adapted(self, mean: Tensor, std: Tensor) -> tuple[Tensor, Tensor]:
        return self.mean_adapter(mean), self.std_adapter(torch.log(std + EPSILON))

    def trace(self, observation: Tensor) -> dict[str, Tensor]:
        """Compute what enters the core, and its mean action."""
        core_input = self.core_input(observation)
        return {"core_input": core_input, "core_output": self.core(core_input)[0]}

    def trace_names(self) -> dict[str, list[str]]:
        """Name the source's elements and its actuators."""
        source = self._specs[0]
        return {
            "core_input": [element.name for element in source.observation],
            "core_output": [actuator.name for actuator in source.action],
        }

    def describe(self) -> str:
        """Describe the dimensions, the adapters, and the parts."""
        return "\n".join((between(*self._specs), "adapters: random", super().describe()))

    def parts(self) -> dict[str, nn.Module | nn.Parameter]:
        """Return the layers, from observation to action."""
        names = ("input_adapter", "input_finetune", "core", "output_finetune", "mean_adapter", "std_adapter")
        return {name: getattr(self, name) for name in names}

    def blueprint(self) -> dict[str, Any]:
        """Return core architecture and specs."""
        return {
            "kind": "paper",
            "core": self.core.architecture.to_json(),
            "source": self._specs[0].to_json(),
            "target": self._specs[1].to_json(),
        }
