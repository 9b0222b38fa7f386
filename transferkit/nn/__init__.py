"""Networks and distributions; every initialisation takes its own generator, none draws from the global one."""

from transferkit.nn.layers import MLP, Linear, ResidualLinear, mlp
from transferkit.nn.normalizer import Normalizer
from transferkit.nn.policy_net import Architecture, PolicyNet

__all__ = ["MLP", "Architecture", "Linear", "Normalizer", "PolicyNet", "ResidualLinear", "mlp"]
