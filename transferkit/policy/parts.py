"""What a trainer learns beside a policy: critics and a model of the environment, new or wrapped like the policy's core."""

from __future__ import annotations

from typing import cast

import numpy as np
import torch
from torch import Tensor, nn

from transferkit.config import DynaConfig
from transferkit.nn import Critic, Dynamics, Ensemble, EnsembleArchitecture, EnsembleLinear, JointInput, Linear, ResidualLinear
from transferkit.nn.optimizer import Part
from transferkit.policy.base import Policy
from transferkit.policy.core import Origin
from transferkit.policy.ends import InputAdapter
from transferkit.policy.match import angle_pairs
from transferkit.policy.sandwich import Sandwich
from transferkit.spec import IOSpec


def make_critic(policy: Policy, config: DynaConfig, generator: torch.Generator) -> Critic:
    """Critics under the policy's observation statistics; the core's own in a sandwich, where it has as many."""
    inputs = policy.obs_dim + policy.act_dim
    new = Ensemble(EnsembleArchitecture(config.critics, inputs, 1, config.hidden, config.layer_norm), generator)
    origin = _origin(policy, "critic") if config.wrap_critic else None
    if origin is None or origin.core.ensembles["critic"].members != config.critics:
        return Critic(JointInput(policy.normalizer), new)
    core = cast("Ensemble", origin.core.critic(origin.member).ensemble)
    return Critic(AdaptedInput(policy, origin, generator), WrappedEnsemble(core, new, origin, generator))


def make_dynamics(policy: Policy, spec: IOSpec, config: DynaConfig, generator: torch.Generator) -> Dynamics:
    """A model under the policy's observation statistics; the core's own in a sandwich, where it has as many members."""
    absolute, width = config.predict == "state", policy.obs_dim + policy.act_dim
    shape = config.model_members, width, Dynamics.out_dim(policy.obs_dim), config.model_hidden, config.layer_norm
    ensemble: nn.Module = (new := Ensemble(EnsembleArchitecture(*shape), generator))
    inputs: nn.Module = JointInput(policy.normalizer)
    origin = _origin(policy, "dynamics") if config.wrap_dynamics else None
    if origin is not None and origin.core.ensembles["dynamics"].members == config.model_members:
        core = cast("Ensemble", origin.core.dynamics(origin.member).ensemble)
        inputs, ensemble = AdaptedInput(policy, origin, generator), WrappedEnsemble(core, new, None, generator)
    return Dynamics(inputs, ensemble, policy.obs_dim, [] if absolute else angle_pairs(spec), absolute=absolute)


def learning_parts(module: nn.Module, policy: Policy) -> list[Part]:
    """All parameters of a critic or a model; those of a wrapped core at the rate of the policy's core."""
    core = [p for child in module.modules() if isinstance(child, WrappedEnsemble) for p in child.core_parameters()]
    known = {id(p) for p in core}
    parts = [Part([p for p in module.parameters() if id(p) not in known])]
    return [*parts, Part(core, policy.lr_scale.get("core", 1.0))] if core else parts


def thaw(module: nn.Module, policy: Policy, progress: float) -> None:
    """Let everything learn, but a wrapped core for as long as the policy's core is frozen."""
    module.requires_grad_(requires_grad=True)
    if progress < policy.freeze.get("core", 0.0):
        for child in module.modules():
            if isinstance(child, WrappedEnsemble):
                child.core.requires_grad_(requires_grad=False)


class AdaptedInput(nn.Module):
    """Target observations and actions as the core's, by the policy's input adapter and actions mapped back, and as they are."""

    def __init__(self, policy: Policy, origin: Origin, generator: torch.Generator) -> None:
        super().__init__()
        self.direct = JointInput(policy.normalizer)
        assert policy.normalizer is not None  # a sandwich has one
        core, found = origin.core, origin.match
        self.source_normalizer = core.normalizer(origin.member)
        self.observation = InputAdapter(policy.normalizer, self.source_normalizer, core.spec.obs_dim, found, generator)
        self.action = Linear(policy.act_dim, core.spec.act_dim, None if found else generator, gain=1.0)
        if found is not None:
            with torch.no_grad():
                self.action.weight.copy_(torch.from_numpy(np.linalg.pinv(np.array(found.action_weight))))
        self.finetune = ResidualLinear(core.spec.obs_dim + core.spec.act_dim)

    def forward(self, observation: Tensor, action: Tensor) -> Tensor:
        """What the core's ensemble sees, then what a new one would, `(..., both sources' obs_dim + act_dim)`."""
        adapted = self.finetune(torch.cat((self.observation(observation), self.action(action)), -1))
        return torch.cat((adapted, self.direct(observation, action)), -1)


class WrappedEnsemble(nn.Module):
    """Hidden layers of a core's ensemble, a residual layer that starts as the identity, and a head; beside them a new ensemble.

    The core sees no more of the target than its own source had. What the values and the changes of a larger robot depend on
    besides, only a path around the core can learn (as the columns of Rusu et al. 2016).
    """

    def __init__(self, core: Ensemble, new: Ensemble, origin: Origin | None, generator: torch.Generator) -> None:
        """With an origin whose adapters are matched the head starts as the core's own, else at random; `new` starts at zero."""
        super().__init__()
        members, width = core.architecture.members, core.architecture.hidden[-1]
        self.core, self.new = core, new
        self.finetune = EnsembleLinear(members, width, width)
        matched = origin is not None and origin.match is not None
        self.head = core.head if matched else EnsembleLinear(members, width, new.architecture.out_dim, generator)
        core.head = nn.Identity()  # type: ignore[assignment] - this one is its head now
        nn.init.zeros_(new.head.weight)
        nn.init.zeros_(new.head.bias)

    def forward(self, x: Tensor) -> Tensor:
        """Outputs `(E, B, out_dim)` of inputs `(B, in_dim)`, or `(E, B, in_dim)` for rows of its own each."""
        adapted, direct = x.split((self.core.architecture.in_dim, self.new.architecture.in_dim), -1)
        features = self.core.features(adapted)
        return self.head(features + self.finetune(features)) + self.new(direct)

    def core_parameters(self) -> list[nn.Parameter]:
        """Of the hidden layers."""
        return list(self.core.body.parameters())


def _origin(policy: Policy, part: str) -> Origin | None:
    origin = policy.origin if isinstance(policy, Sandwich) else None
    return origin if origin is not None and part in origin.core.ensembles else None
