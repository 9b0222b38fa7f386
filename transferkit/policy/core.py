"""A core in memory: the trained networks of one recipe, one member per source seed."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace

import torch
from torch import Tensor

from transferkit.errors import ConfigError
from transferkit.nn import Architecture, Normalizer, PolicyNet
from transferkit.policy.base import ScratchPolicy
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
    """Per part (`policy`, `normalizer`) the tensors by name, each with a leading axis over members."""
    digest: str = ""
    """Hash of the artifact it came from."""

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

    def _of(self, part: str, member: int) -> dict[str, Tensor]:
        if not 0 <= member < len(self.seeds):
            raise ConfigError(f"core {self.id} has no member {member}; it has 0 to {len(self.seeds) - 1}")
        return {name: tensor[member] for name, tensor in self.parts[part].items()}

    def randomized(self, seed: int) -> Core:
        """The control that shares nothing but the architecture: every member freshly initialised."""
        generator = Streams(seed).torch("random core")
        fresh = [PolicyNet(self.architecture, generator).state_dict() for _ in self.seeds]
        network = {name: torch.stack([state[name] for state in fresh]) for name in self.parts["policy"]}
        return replace(self, id=f"{self.id} (random)", parts={**self.parts, "policy": network})

    def shuffled(self, seed: int) -> Core:
        """The control that shares every layer's distribution of weights: each tensor permuted within itself."""
        generator = Streams(seed).torch("shuffled core")
        network = {}
        for name, tensor in self.parts["policy"].items():
            rows = [row.flatten()[torch.randperm(row.numel(), generator=generator)].view_as(row) for row in tensor]
            network[name] = torch.stack(rows)
        return replace(self, id=f"{self.id} (shuffled)", parts={**self.parts, "policy": network})
