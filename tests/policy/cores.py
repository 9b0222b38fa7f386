"""Cores for any environment."""

import torch

from transferkit.nn import Architecture, Normalizer, PolicyNet
from transferkit.policy.core import Core, stack_members


def random_core(spec):
    """An untrained core with statistics that are not 0 and 1."""
    generator = torch.Generator().manual_seed(0)
    architecture = Architecture(spec.obs_dim, spec.act_dim, (16, 16), "tanh", "parameter", "orthogonal")
    network, normalizer = PolicyNet(architecture, generator, init_std=1.0), Normalizer(spec.obs_dim)
    normalizer.mean.copy_(torch.randn(spec.obs_dim, generator=generator))
    components = {"policy": stack_members([network.state_dict()]), "normalizer": stack_members([normalizer.state_dict()])}
    return Core("random-v1", spec, architecture, [0], components)
