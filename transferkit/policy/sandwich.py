"""The healthy sandwich: normaliser, input adapter, input fine-tune, core, output fine-tune, output adapter."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import asdict
from typing import TYPE_CHECKING, Any

import torch
from torch import Tensor, nn

from transferkit.envs import derive_spec, is_written
from transferkit.errors import ConfigError
from transferkit.matching import explain
from transferkit.nn import Linear, Normalizer, ResidualLinear, gaussian, mlp
from transferkit.policy.adapters import InputAdapter, output_adapter
from transferkit.policy.base import Policy, between

if TYPE_CHECKING:
    from transferkit.config import WrapConfig
    from transferkit.matching import Match
    from transferkit.nn import PolicyNet
    from transferkit.policy.composed import ComposedNet
    from transferkit.policy.core import Origin
    from transferkit.spec import IOSpec


class Sandwich(Policy):
    """A core between two adapters; only linear maps around it, and a bounded log-std that does not depend on the state."""

    has_core = True

    def __init__(
        self,
        core: PolicyNet | ComposedNet,
        source_normalizer: Normalizer | None,
        specs: tuple[IOSpec, IOSpec],
        config: WrapConfig,
        match: Match | None,
        generators: dict[str, torch.Generator] | None,
        *,
        origin: Origin | None = None,
    ) -> None:
        """Build the layers around a core; without generators the weights are zero, to be loaded."""
        super().__init__()
        source, target = specs
        generators = generators or {}
        self._specs, self._match, self.config = specs, match, config
        self.squash = config.tap == "features" and core.architecture.squash
        self.origin = origin
        self._adapter = "random" if match is None else "pad" if config.adapter == "pad" else "semantic"
        self.obs_dim, self.act_dim = target.obs_dim, target.act_dim
        self.lr_scale, self.freeze = dict(config.lr_scale), dict(config.freeze)
        self.normalizer = Normalizer(target.obs_dim)
        self.source_normalizer = source_normalizer
        self.copies, self.hold = (1, 1) if match is None else (match.copies, match.hold)
        features = config.tap == "features"
        d_core, d_tap = source.obs_dim, core.feature_dim if features else source.act_dim
        self.input_adapter = InputAdapter(self.normalizer, source_normalizer, d_core, match, generators.get("input_adapter"))
        self.input_finetune = ResidualLinear(d_core) if config.finetune else nn.Identity()
        self.core = core
        self.output_finetune = ResidualLinear(d_tap) if config.finetune else nn.Identity()
        head = core.mean_head if features else None
        self.output_adapter = output_adapter(d_tap, target.act_dim, match, head, generators.get("output_adapter"))
        self.log_std = nn.Parameter(_initial_log_std(core, match, target.act_dim, config))
        self.residual = self._residual_column(config.residual, generators.get("residual")) if config.residual else None
        self._check_part_names()

    def check_fits(self, needed: tuple[int, int], name: str) -> None:
        """Compare dimensions, and what the numbers mean, with an environment's.

        Raises:
            ConfigError: they differ.
        """
        super().check_fits(needed, name)
        target = self._specs[1]
        if name == target.env_id or not is_written(name) or not is_written(target.env_id):
            return
        if not target.has_the_numbers_of(derive_spec(name)):
            raise ConfigError(
                f"the policy was wrapped onto {target.env_id}, and the numbers of {name} mean something else",
                remedy="wrap the core onto that environment",
            )

    def core_input(self, observation: Tensor) -> Tensor:
        """Compute what every copy of the core sees, `(B, copies * d_source)`."""
        return self._each(self.input_finetune, self.input_adapter(observation))

    def forward(self, observation: Tensor) -> tuple[Tensor, Tensor]:
        """Compute mean and log-std of the action."""
        mean = self.output_adapter(self._around_core(observation))
        if self.residual is not None:
            mean = mean + self.residual(self.normalized(observation))
        return self._bounded(mean)

    def features(self, observation: Tensor) -> Tensor:
        """Compute all that the mean action is a linear map of, for another sandwich to take: also around the core."""
        tapped = self._around_core(observation)
        if self.residual is None:
            return tapped
        return torch.cat((tapped, self.residual[0](self.normalized(observation))), -1)

    def head(self) -> Linear:
        """Copy the linear map from `features` to the mean action, before it is squashed."""
        layers = [self.output_adapter] if self.residual is None else [self.output_adapter, self.residual[1]]
        head = Linear(sum(layer.in_features for layer in layers), self.act_dim)
        with torch.no_grad():
            head.weight.copy_(torch.cat([layer.weight for layer in layers], 1))
            head.bias.copy_(torch.stack([layer.bias for layer in layers]).sum(0))
        return head

    def distribution(self, features: Tensor) -> tuple[Tensor, Tensor]:
        """Compute mean and log-std of the action from `features`."""
        width = self.output_adapter.in_features
        mean = self.output_adapter(features[:, :width])
        if self.residual is not None:
            mean = mean + self.residual[1](features[:, width:])
        return self._bounded(mean)

    def trace(self, observation: Tensor) -> dict[str, Tensor]:
        """Compute what enters the core and what is taken from it."""
        core_input = self.core_input(observation)
        return {"core_input": core_input, "core_output": self._each(self._tapped, core_input)}

    def trace_names(self) -> dict[str, list[str]]:
        """Name the source's elements, and features by number or the source's actuators."""
        source = self._specs[0]
        features = [f"feature_{i}" for i in range(self.core.feature_dim)]
        output = features if self.config.tap == "features" else [actuator.name for actuator in source.action]
        return {"core_input": self._every([element.name for element in source.observation]), "core_output": self._every(output)}

    def _bounded(self, mean: Tensor) -> tuple[Tensor, Tensor]:
        if self.squash:
            mean = torch.tanh(mean)
        return mean, self.log_std.clamp(*gaussian.LOG_STD_BOUNDS).expand_as(mean)

    def _around_core(self, observation: Tensor) -> Tensor:
        """Compute what the output adapter takes, `(B, copies * d_tap)`."""
        tapped = self._each(self._tapped, self.core_input(observation))
        return self._each(self.output_finetune, tapped)

    def _each(self, layer: Callable[[Tensor], Tensor], x: Tensor) -> Tensor:
        """Apply a layer of one copy to those of every copy, which are side by side."""
        if self.copies == 1:
            return layer(x)
        return layer(x.unflatten(-1, (self.copies, -1)).flatten(0, 1)).unflatten(0, (-1, self.copies)).flatten(1)

    def _every(self, names: list[str]) -> list[str]:
        """Name the elements of every copy."""
        return names if self.copies == 1 else [f"{name}[{k + 1}]" for k in range(self.copies) for name in names]

    def _tapped(self, core_input: Tensor) -> Tensor:
        features = self.core.features(core_input)
        return features if self.config.tap == "features" else self.core.action_distribution(features)[0]

    @property
    def target(self) -> IOSpec:
        """Meaning of the observation and the action."""
        return self._specs[1]

    def parts(self) -> dict[str, nn.Module | nn.Parameter]:
        """Return the layers with parameters, from observation to action."""
        parts: dict[str, nn.Module | nn.Parameter] = {"input_adapter": self.input_adapter}
        if self.config.finetune:
            parts["input_finetune"] = self.input_finetune
        parts["core"] = self.core
        if self.config.finetune:
            parts["output_finetune"] = self.output_finetune
        parts["output_adapter"] = self.output_adapter
        if self.residual is not None:
            parts["residual"] = self.residual
        return parts | {"log_std": self.log_std}

    def describe(self) -> str:
        """Describe the dimensions, what the adapters were matched with, and the parts."""
        source, target = self._specs
        ends = f"{between(source, target)}, tap={self.config.tap}"
        if self._match is None:
            adapters = "adapters: random; nothing is matched"
        else:
            adapters = f"adapters: {self._adapter}\n{explain(self._match, source, target)}"
        return "\n".join((ends, adapters, super().describe()))

    def blueprint(self) -> dict[str, Any]:
        """Return core architecture, specs and options."""
        return {
            "kind": "sandwich",
            "core": self.core.architecture.to_json(),
            "source_normalizer": self.source_normalizer is not None,
            "source": self._specs[0].to_json(),
            "target": self._specs[1].to_json(),
            "tap": self.config.tap,
            "finetune": self.config.finetune,
            "residual": self.config.residual,
            "adapter": self._adapter,
            "match": None if self._match is None else asdict(self._match),
        }

    def _residual_column(self, width: int, generator: torch.Generator | None) -> nn.Sequential:
        """Make a side network that starts at zero (progressive networks, Rusu et al. 2016)."""
        hidden = mlp(self.obs_dim, (width,), "tanh", generator, gain=math.sqrt(2))
        return nn.Sequential(hidden, Linear(width, self.act_dim))


def _initial_log_std(core: PolicyNet | ComposedNet, match: Match | None, act_dim: int, config: WrapConfig) -> Tensor:
    """Take the configured one, and the core's own for actuators that drive what the core drove."""
    log_std = torch.full((act_dim,), math.log(config.init_std))
    if match is not None and core.architecture.std == "parameter":
        for k, row in enumerate(match.action_weight):
            for j, weight in enumerate(row):
                if weight:
                    log_std[k] = core.log_std.detach()[j % len(core.log_std)]  # its own, in the target's action range
    return log_std.clamp(min=math.log(config.least_std)) if config.least_std else log_std
