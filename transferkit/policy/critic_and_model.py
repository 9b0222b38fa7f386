"""Critics and a model of the environment, learnt beside a policy: new, or wrapped like the policy's core."""

from __future__ import annotations

import logging
from collections.abc import Sequence
from typing import TYPE_CHECKING

import numpy as np
import torch
from torch import Tensor, nn

from transferkit.matching import angle_pairs
from transferkit.nn import (
    Critic,
    Dynamics,
    Ensemble,
    EnsembleArchitecture,
    JointInput,
    Linear,
    ResidualLinear,
)
from transferkit.policy.adapters import InputAdapter
from transferkit.policy.wrapped_ensemble import WrappedEnsemble

LOGGER = logging.getLogger("transferkit")

if TYPE_CHECKING:
    from transferkit.config import DynaConfig, ModelConfig
    from transferkit.policy.base import Policy
    from transferkit.policy.core import Origin
    from transferkit.spec import IOSpec


def make_critic(
    policy: Policy, config: DynaConfig, hidden: Sequence[int], generator: torch.Generator, *, wrapped: bool = False
) -> Critic:
    """Make critics under the policy's observation statistics.

    `wrapped` takes the core's own in a sandwich, if it has as many.
    """
    width = policy.obs_dim + policy.act_dim
    new = Ensemble(
        EnsembleArchitecture(config.critics, width, 1, tuple(hidden), config.layer_norm, config.unit_norm), generator
    )
    origin = _origin(policy, "critic", config.critics) if wrapped else None
    if wrapped and origin is None and policy.origin is not None:
        core, needed = policy.origin.core, f"{config.critics} critics (dyna.critics), and to drive one limb"
        found = core.ensembles["critic"].members if "critic" in core.ensembles else 0
        LOGGER.warning("wrap.critic has no effect: %s has %d critics, and needs %s", core.id, found, needed)
    if origin is None:
        return Critic(JointInput(policy.normalizer), new)
    core = _ensemble(origin.core.critic(origin.member).ensemble)
    return Critic(AdaptedInput(policy, origin, generator), WrappedEnsemble(core, new, origin, generator))


def make_dynamics(
    policy: Policy, spec: IOSpec, config: ModelConfig, generator: torch.Generator, *, wrapped: bool = True
) -> Dynamics:
    """Make a model under the policy's observation statistics.

    `wrapped` takes the core's own in a sandwich, if it has as many members.
    """
    absolute, width = config.predict == "state", policy.obs_dim + policy.act_dim
    out_dim = Dynamics.out_dim(policy.obs_dim)
    new = Ensemble(EnsembleArchitecture(config.members, width, out_dim, config.hidden, config.layer_norm), generator)
    inputs, ensemble = JointInput(policy.normalizer), new
    origin = _origin(policy, "dynamics", config.members) if wrapped else None
    if origin is not None:
        core = _ensemble(origin.core.dynamics(origin.member).ensemble)
        inputs, ensemble = AdaptedInput(policy, origin, generator), WrappedEnsemble(core, new, None, generator)
    return Dynamics(inputs, ensemble, policy.obs_dim, [] if absolute else angle_pairs(spec), absolute=absolute)


class AdaptedInput(nn.Module):
    """Target observations and actions as the core's, by the policy's input adapter and actions mapped back, and as they are."""

    def __init__(self, policy: Policy, origin: Origin, generator: torch.Generator) -> None:
        super().__init__()
        self.direct = JointInput(policy.normalizer)
        assert policy.normalizer is not None  # a sandwich has one
        core, match = origin.core, origin.match
        self.source_normalizer = core.normalizer(origin.member)
        self.observation = InputAdapter(policy.normalizer, self.source_normalizer, core.spec.obs_dim, match, generator)
        self.action = Linear(policy.act_dim, core.spec.act_dim, None if match else generator, gain=1.0)
        if match is not None:
            with torch.no_grad():
                back = np.linalg.pinv(np.array(match.action_weight))
                self.action.weight.copy_(torch.from_numpy(back))
                if match.action_bias:
                    self.action.bias.copy_(torch.from_numpy(-back @ match.action_bias))
        self.finetune = ResidualLinear(core.spec.obs_dim + core.spec.act_dim)

    def forward(self, observation: Tensor, action: Tensor) -> Tensor:
        """Join what the core's ensemble sees and what a new one would, `(..., both sources' obs_dim + act_dim)`."""
        adapted = self.finetune(torch.cat((self.observation(observation), self.action(action)), -1))
        return torch.cat((adapted, self.direct(observation, action)), -1)


def _ensemble(module: nn.Module) -> Ensemble:
    assert isinstance(module, Ensemble)
    return module


def _origin(policy: Policy, component: str, members: int) -> Origin | None:
    """Where a sandwich's core comes from, if it has this component with as many members, and acts in one copy alone."""
    origin = policy.origin
    if origin is None or policy.normalizer is None or component not in origin.core.ensembles:
        return None
    if origin.match is not None and origin.match.copies > 1:  # a component judges one copy's inputs and actions
        return None
    return origin if origin.core.ensembles[component].members == members else None
