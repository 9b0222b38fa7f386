import pytest

from transferkit.envs import derive_spec
from transferkit.nn import Architecture, PolicyNet
from transferkit.policy.core import Core, stack_members
from transferkit.streams import Streams

IDP, CARTPOLE = "InvertedDoublePendulum-v5", "dm_control/cartpole-balance-v0"


@pytest.fixture(scope="session")
def specs():
    return {name: derive_spec(name) for name in ("InvertedPendulum-v5", IDP, CARTPOLE, "Hopper-v5", "Pendulum-v1")}


@pytest.fixture(scope="session")
def paper_core(specs):
    """An untrained core of the paper's architecture."""
    architecture = Architecture(4, 1, (128, 128), "relu", "head")
    state = PolicyNet(architecture, Streams(0).torch("core")).state_dict()
    return Core("paper", specs["InvertedPendulum-v5"], architecture, (0,), {"policy": stack_members([state])})
