"""Networks and distributions; every initialisation takes its own generator, none draws from the global one."""

from transferkit.nn import gaussian
from transferkit.nn.critic import Critic, JointInput, StateCritic, Value
from transferkit.nn.dynamics import Dynamics, Prediction
from transferkit.nn.ensemble import Ensemble, EnsembleArchitecture, EnsembleLinear
from transferkit.nn.layers import ACTIVATIONS, MLP, Linear, ResidualLinear, mlp, one_thread
from transferkit.nn.learner import Learner
from transferkit.nn.normalizer import Normalizer, Shared
from transferkit.nn.optimizer import Part, PartAdam, flatten
from transferkit.nn.policy_net import Architecture, PolicyNet

__all__ = [
    "ACTIVATIONS",
    "MLP",
    "Architecture",
    "Critic",
    "Dynamics",
    "Ensemble",
    "EnsembleArchitecture",
    "EnsembleLinear",
    "JointInput",
    "Learner",
    "Linear",
    "Normalizer",
    "Part",
    "PartAdam",
    "PolicyNet",
    "Prediction",
    "ResidualLinear",
    "Shared",
    "StateCritic",
    "Value",
    "flatten",
    "gaussian",
    "mlp",
    "one_thread",
]
