"""Policies: from raw observations to a distribution over actions, from scratch or around a core."""

from transferkit.policy.base import ConstantPolicy, ParameterGroup, Policy, ScratchPolicy
from transferkit.policy.core import Core, stack_members
from transferkit.policy.create import new_policy, scratch_policy
from transferkit.policy.critic_and_model import learning_parts, make_critic, make_dynamics, thaw
from transferkit.policy.health import Health, health, play
from transferkit.policy.match import Match, match
from transferkit.policy.saved import Component, load_components, load_policy, load_saved, state_of
from transferkit.policy.wrap import as_saved, build, wrap

__all__ = [
    "Component",
    "ConstantPolicy",
    "Core",
    "Health",
    "Match",
    "ParameterGroup",
    "Policy",
    "ScratchPolicy",
    "as_saved",
    "build",
    "health",
    "learning_parts",
    "load_components",
    "load_policy",
    "load_saved",
    "make_critic",
    "make_dynamics",
    "match",
    "new_policy",
    "play",
    "scratch_policy",
    "stack_members",
    "state_of",
    "thaw",
    "wrap",
]
