"""Policies: from raw observations to a distribution over actions, from scratch or around a core."""

from transferkit.policy.base import ConstantPolicy, ParameterGroup, Policy, ScratchPolicy
from transferkit.policy.health import Health, health
from transferkit.policy.match import Match, match
from transferkit.policy.wrap import build, wrap

__all__ = ["ConstantPolicy", "Health", "Match", "ParameterGroup", "Policy", "ScratchPolicy", "build", "health", "match", "wrap"]
