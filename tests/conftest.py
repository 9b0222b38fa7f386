import warnings
from dataclasses import replace

import numpy as np
import pytest
import torch

from transferkit.envs import derive_spec
from transferkit.nn import Architecture, Dynamics, Ensemble, EnsembleArchitecture, Normalizer, PolicyNet
from transferkit.policy.core import Core, stack_members
from transferkit.streams import Streams
from transferkit.zoo.artifact import ensemble_card, normalizer_card, policy_card, save_core
from transferkit.zoo.card import read_card
from transferkit.zoo.catalog import find_core

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
    components = {
        "policy": stack_members([network.state_dict() for network in networks]),
        "normalizer": stack_members([normalizer.state_dict()] * 2),
    }
    return Core("test-v1", pendulum_spec, architecture, (0, 1), components)


@pytest.fixture
def full_core(untrained_core):
    """The untrained core with two critics and a model of three members."""
    spec, components, architectures = untrained_core.spec, dict(untrained_core.components), {}
    for name, members, outputs in (("critic", 2, 1), ("dynamics", 3, Dynamics.out_dim(spec.obs_dim))):
        architectures[name] = EnsembleArchitecture(members, spec.obs_dim + spec.act_dim, outputs, (16, 16))
        ensemble = Ensemble(architectures[name], Streams(3).torch(name)).state_dict()
        state = {f"ensemble.{key}": tensor for key, tensor in ensemble.items()}
        if name == "dynamics":
            state |= {"mean": torch.zeros(spec.obs_dim + 1), "std": torch.ones(spec.obs_dim + 1)}
        components[name] = stack_members([state, state])
    return replace(untrained_core, components=components, ensembles=architectures)


@pytest.fixture
def save():
    """Writes a core of two members into a folder, with the card of a released one."""

    def write(core, folder):
        card = read_card(find_core("inverted-pendulum-v1"))
        components = {
            "policy": policy_card(core.architecture),
            "normalizer": normalizer_card(core.spec.obs_dim),
            **{name: ensemble_card(name, architecture) for name, architecture in core.ensembles.items()},
        }
        two = {"seeds": (0, 1), "spent": card.spent[:2], "score": replace(card.score, members=card.score.members[:2])}
        save_core(core, replace(card, id=core.id, components=components, **two), folder)
        return folder

    return write


@pytest.fixture
def full_core_folder(full_core, save, tmp_path):
    """The artifact of the full core."""
    return save(full_core, tmp_path / "test-v1")
