"""A core in memory: the trained networks of one recipe, one member per source seed."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from numbers import Integral
from typing import TYPE_CHECKING

import torch
from torch import Tensor

from transferkit.errors import ConfigError, SettingError
from transferkit.matching import angle_pairs
from transferkit.nn import Architecture, Critic, Dynamics, Ensemble, JointInput, Normalizer, PolicyNet
from transferkit.policy.base import ScratchPolicy
from transferkit.policy.blueprints import build_network
from transferkit.streams import Streams

if TYPE_CHECKING:
    from transferkit.matching import Match
    from transferkit.nn import EnsembleArchitecture
    from transferkit.policy.base import Policy
    from transferkit.policy.composed import Composed, ComposedNet
    from transferkit.spec import IOSpec


@dataclass(frozen=True)
class Core:
    """Components of a policy that was trained on a source environment; made by `load_core` or by `pretrain`."""

    id: str
    spec: IOSpec = field(repr=False)
    """Meaning of the source's observation and action."""
    architecture: Architecture | Composed
    """Of its network; composed if it was trained around a core itself."""
    seeds: Sequence[int]
    """Source seed of each member."""
    components: Mapping[str, Mapping[str, Tensor]] = field(repr=False)
    """Tensors by name of each component (`policy`, `normalizer`, `critic`, `dynamics`), with a leading axis over members."""
    digest: str = ""
    """Hash of the artifact that it came from, or of the policy of a run."""
    ensembles: Mapping[str, EnsembleArchitecture] = field(default_factory=dict)
    """Architectures of its `critic` and `dynamics`, if it has them."""

    def network(self, member: int = 0) -> PolicyNet | ComposedNet:
        """Build the policy network of a member.

        Raises:
            ConfigError: there is no such member.
        """
        network = build_network(self.architecture.to_json())
        network.load_state_dict(self._of("policy", member))
        return network

    def normalizer(self, member: int = 0) -> Normalizer | None:
        """Build the observation statistics of the member's source, if it was trained with any, as its network takes them."""
        return self._normalizer(member, clip=isinstance(self.architecture, Architecture))

    def _normalizer(self, member: int, *, clip: bool = True) -> Normalizer | None:
        if "normalizer" not in self.components:
            return None
        normalizer = Normalizer(self.spec.obs_dim, clip=clip)
        normalizer.load_state_dict(self._of("normalizer", member))
        return normalizer

    def policy(self, member: int = 0) -> Policy:
        """Build the member as a policy for its own source environment."""
        network = self.network(member)
        return ScratchPolicy(network, self.normalizer(member)) if isinstance(network, PolicyNet) else network.policy

    def critic(self, member: int = 0) -> Critic:
        """Build the member's critics, for its source.

        Raises:
            ConfigError: the core has none.
        """
        critic = Critic(JointInput(self._normalizer(member)), self._ensemble("critic"))
        critic.load_state_dict(self._of("critic", member))
        return critic

    def dynamics(self, member: int = 0) -> Dynamics:
        """Build the member's model of its source.

        Raises:
            ConfigError: the core has none.
        """
        inputs, obs_dim = JointInput(self._normalizer(member)), self.spec.obs_dim
        model = Dynamics(inputs, self._ensemble("dynamics"), obs_dim, angle_pairs(self.spec))
        model.load_state_dict(self._of("dynamics", member))
        return model

    def _ensemble(self, name: str) -> Ensemble:
        if name not in self.ensembles:
            raise ConfigError(f"core {self.id} has no {name}", topic="cores")
        return Ensemble(self.ensembles[name])

    def _of(self, component: str, member: int) -> dict[str, Tensor]:
        if not isinstance(member, Integral) or isinstance(member, bool) or not 0 <= member < len(self.seeds):
            raise SettingError("member", value=member, allowed=f"0 to {len(self.seeds) - 1} for core {self.id}")
        return {name: tensor[member] for name, tensor in self.components[component].items()}

    def randomized(self, seed: int, *, init_std: float = 1.0) -> Core:
        """Make the control that shares architecture and observation statistics: every member freshly initialised."""
        generator = Streams(seed).torch("random core")
        components = dict(self.components)
        blueprint = self.architecture.to_json()
        new = [build_network(blueprint, generator, init_std=init_std).state_dict() for _ in self.seeds]
        statistics = {name: tensor for name, tensor in self.components["policy"].items() if _is_statistic(name)}
        components["policy"] = stack_members(new) | statistics
        for name, architecture in self.ensembles.items():
            fresh = stack_members([Ensemble(architecture, generator).state_dict() for _ in self.seeds])
            components[name] = {**self.components[name], **{f"ensemble.{key}": tensor for key, tensor in fresh.items()}}
        return replace(self, id=f"{self.id} (random)", components=components)

    def shuffled(self, seed: int) -> Core:
        """Make the control that shares every layer's distribution of weights: each tensor permuted within itself.

        The tensors are drawn for in the order of their names, so that a seed always gives the same.
        """
        generator = Streams(seed).torch("shuffled core")
        components = dict(self.components)
        for name in ("policy", *self.ensembles):
            tensors = self.components[name]
            permuted = {key: _permute(tensors[key], generator) for key in sorted(tensors) if not _is_statistic(key)}
            components[name] = {**tensors, **permuted}
        return replace(self, id=f"{self.id} (shuffled)", components=components)


def stack_members(states: Sequence[Mapping[str, Tensor]]) -> dict[str, Tensor]:
    """Stack the state dicts of a core's members, each tensor with a leading axis over members."""
    return {name: torch.stack([state[name] for state in states]) for name in states[0]}


def _is_statistic(name: str) -> bool:
    """Whether a tensor describes observations, and is no weight."""
    return name.rpartition(".")[2] in ("mean", "var", "std", "count")


def _permute(members: Tensor, generator: torch.Generator) -> Tensor:
    rows = [row.flatten()[torch.randperm(row.numel(), generator=generator)].view_as(row) for row in members]
    return torch.stack(rows)


@dataclass(frozen=True)
class Origin:
    """Where a sandwich comes from: for the record, and so that critic and model can be wrapped like its policy."""

    core: Core
    member: int
    match: Match | None
