import warnings
from dataclasses import replace

import numpy as np
import pytest
import torch

from transferkit.envs import derive_spec
from transferkit.nn import Architecture, Dynamics, Ensemble, EnsembleArchitecture, Normalizer, PolicyNet
from transferkit.policy.core import Core
from transferkit.run.streams import Streams

warnings.simplefilter("ignore")
torch.set_num_threads(1)


@pytest.fixture(scope="session")
def pendulum_spec():
    return derive_spec("InvertedPendulum-v5")


@pytest.fixture
def untrained_core(pendulum_spec):
    """Two members of an untrained pendulum policy with made-up statistics."""
    architecture = Architecture(4, 1, (16, 16))
    networks = [PolicyNet(architecture, Streams(seed).torch("test")) for seed in (0, 1)]
    for network in networks:
        torch.nn.init.normal_(network.mean_head.weight, generator=Streams(5).torch("head"))
    normalizer = Normalizer(4)
    normalizer.update(torch.from_numpy(np.random.default_rng(0).normal(0.1, 0.5, (100, 4)).astype(np.float32)))
    stack = lambda states: {name: torch.stack([s[name] for s in states]) for name in states[0]}  # noqa: E731
    parts = {
        "policy": stack([network.state_dict() for network in networks]),
        "normalizer": stack([normalizer.state_dict()] * 2),
    }
    return Core("test-v1", pendulum_spec, architecture, (0, 1), parts)


@pytest.fixture
def core_with_parts(untrained_core):
    """The untrained core with two critics and a model of three members."""
    spec, parts, architectures = untrained_core.spec, dict(untrained_core.parts), {}
    for name, members, outputs in (("critic", 2, 1), ("dynamics", 3, Dynamics.out_dim(spec.obs_dim))):
        architectures[name] = EnsembleArchitecture(members, spec.obs_dim + spec.act_dim, outputs, (16, 16))
        ensemble = Ensemble(architectures[name], Streams(3).torch(name)).state_dict()
        state = {f"ensemble.{key}": tensor for key, tensor in ensemble.items()}
        if name == "dynamics":
            state |= {"mean": torch.zeros(spec.obs_dim + 1), "std": torch.ones(spec.obs_dim + 1)}
        parts[name] = {key: torch.stack((tensor, tensor)) for key, tensor in state.items()}
    return replace(untrained_core, parts=parts, ensembles=architectures)
