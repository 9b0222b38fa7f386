"""Networks and distributions; every initialisation takes its own generator, none draws from the global one."""

from transferkit.nn.critic import Critic, JointInput, StateCritic, Value
from transferkit.nn.dynamics import Dynamics
from transferkit.nn.ensemble import Ensemble, EnsembleArchitecture, EnsembleLinear
from transferkit.nn.layers import MLP, Linear, ResidualLinear, mlp
from transferkit.nn.normalizer import Normalizer
from transferkit.nn.policy_net import Architecture, PolicyNet

__all__ = [
    "MLP",
    "Architecture",
    "Critic",
    "Dynamics",
    "Ensemble",
    "EnsembleArchitecture",
    "EnsembleLinear",
    "JointInput",
    "Linear",
    "Normalizer",
    "PolicyNet",
    "ResidualLinear",
    "StateCritic",
    "Value",
    "mlp",
]
