"""A core in memory: the trained networks of one recipe, one member per source seed."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace

import torch
from torch import Tensor

from transferkit.errors import ConfigError
from transferkit.nn import Architecture, Critic, Dynamics, Ensemble, EnsembleArchitecture, JointInput, Normalizer, PolicyNet
from transferkit.policy.base import ScratchPolicy
from transferkit.policy.match import Match, angle_pairs
from transferkit.run.streams import Streams
from transferkit.spec import IOSpec


@dataclass(frozen=True)
class Core:
    """Parts of a policy that was trained on a source environment; made by `load_core` or by `pretrain`."""

    id: str
    spec: IOSpec
    """Meaning of the source's observation and action."""
    architecture: Architecture
    seeds: Sequence[int]
    """Source seed of each member."""
    parts: Mapping[str, Mapping[str, Tensor]]
    """Per part (`policy`, `normalizer`, `critic`, `dynamics`) the tensors by name, each with a leading axis over members."""
    digest: str = ""
    """Hash of the artifact it came from."""
    ensembles: Mapping[str, EnsembleArchitecture] = field(default_factory=dict)
    """Architectures of its `critic` and `dynamics`, where it has them."""

    def network(self, member: int = 0) -> PolicyNet:
        """The policy network of a member.

        Raises:
            ConfigError: there is no such member.
        """
        network = PolicyNet(self.architecture)
        network.load_state_dict(self._of("policy", member))
        return network

    def normalizer(self, member: int = 0) -> Normalizer | None:
        """Observation statistics of the member's source, where it was trained with any."""
        if "normalizer" not in self.parts:
            return None
        normalizer = Normalizer(self.spec.obs_dim)
        normalizer.load_state_dict(self._of("normalizer", member))
        return normalizer

    def policy(self, member: int = 0) -> ScratchPolicy:
        """The member as a policy for its own source environment."""
        return ScratchPolicy(self.network(member), self.normalizer(member))

    def critic(self, member: int = 0) -> Critic:
        """The member's critics, for its source.

        Raises:
            ConfigError: the core has none.
        """
        critic = Critic(JointInput(self.normalizer(member)), self._ensemble("critic"))
        critic.load_state_dict(self._of("critic", member))
        return critic

    def dynamics(self, member: int = 0) -> Dynamics:
        """The member's model of its source.

        Raises:
            ConfigError: the core has none.
        """
        inputs, obs_dim = JointInput(self.normalizer(member)), self.spec.obs_dim
        model = Dynamics(inputs, self._ensemble("dynamics"), obs_dim, angle_pairs(self.spec))
        model.load_state_dict(self._of("dynamics", member))
        return model

    def _ensemble(self, part: str) -> Ensemble:
        if part not in self.ensembles:
            raise ConfigError(f"core {self.id} has no {part}; `transferkit zoo list` shows the parts of every core")
        return Ensemble(self.ensembles[part])

    def _of(self, part: str, member: int) -> dict[str, Tensor]:
        if not 0 <= member < len(self.seeds):
            raise ConfigError(f"core {self.id} has no member {member}; it has 0 to {len(self.seeds) - 1}")
        return {name: tensor[member] for name, tensor in self.parts[part].items()}

    def randomized(self, seed: int, *, init_std: float = 1.0) -> Core:
        """The control that shares architecture and observation statistics: every member freshly initialised."""
        generator = Streams(seed).torch("random core")
        parts = dict(self.parts)
        parts["policy"] = stack_members(
            [PolicyNet(self.architecture, generator, init_std=init_std).state_dict() for _ in self.seeds]
        )
        for name, architecture in self.ensembles.items():
            fresh = stack_members([Ensemble(architecture, generator).state_dict() for _ in self.seeds])
            parts[name] = {**self.parts[name], **{f"ensemble.{key}": tensor for key, tensor in fresh.items()}}
        return replace(self, id=f"{self.id} (random)", parts=parts)

    def shuffled(self, seed: int) -> Core:
        """The control that shares every layer's distribution of weights: each tensor permuted within itself."""
        generator = Streams(seed).torch("shuffled core")
        parts = dict(self.parts)
        for part in ("policy", *self.ensembles):
            networks = {name: tensor for name, tensor in self.parts[part].items() if name not in ("mean", "std")}
            parts[part] = {**self.parts[part], **{name: _permute(tensor, generator) for name, tensor in networks.items()}}
        return replace(self, id=f"{self.id} (shuffled)", parts=parts)


def stack_members(states: Sequence[Mapping[str, Tensor]]) -> dict[str, Tensor]:
    """The state dicts of a core's members as one, each tensor with a leading axis over members."""
    return {name: torch.stack([state[name] for state in states]) for name in states[0]}


def _permute(members: Tensor, generator: torch.Generator) -> Tensor:
    rows = [row.flatten()[torch.randperm(row.numel(), generator=generator)].view_as(row) for row in members]
    return torch.stack(rows)


@dataclass(frozen=True)
class Origin:
    """Where a sandwich comes from, so that critic and model can be wrapped like its policy."""

    core: Core
    member: int
    match: Match | None
