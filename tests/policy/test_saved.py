import pytest
import torch

from transferkit import load_policy, scratch_policy, wrap
from transferkit.config import DynaConfig, ModelConfig
from transferkit.errors import RunDirectoryError
from transferkit.nn import StateCritic
from transferkit.policy.critic_and_model import make_critic, make_dynamics
from transferkit.policy.saved import load_components, state_of
from transferkit.run import RunDirectory, load_state, save_state
from transferkit.streams import Streams

IDP = "InvertedDoublePendulum-v5"


@pytest.fixture
def saved(tmp_path):
    """Writes a policy and what was trained beside it into a run directory."""

    def write(policy, **beside):
        with RunDirectory.create(tmp_path / "run", {}) as run:
            run.save_policy(state_of(policy, beside))
        return tmp_path / "run"

    return write


def test_a_policy_acts_after_loading_as_before(saved):
    policy = scratch_policy(IDP, seed=1)
    policy.update_normalizer(torch.randn(50, 9, generator=Streams(0).torch("x")))
    loaded, observation = load_policy(saved(policy)), torch.randn(3, 9, generator=Streams(1).torch("x"))
    assert all(torch.equal(a, b) for a, b in zip(policy(observation), loaded(observation), strict=True))


def test_what_was_trained_from_scratch_is_kept_for_a_core_and_nothing_else(saved, full_core, pendulum_spec):
    policy, generator = wrap(full_core, IDP), Streams(0).torch("x")
    critic = make_critic(policy, DynaConfig(critics=2), (8,), generator)
    wrapped = make_dynamics(policy, pendulum_spec, ModelConfig(members=3), generator)
    value = StateCritic(9, (8,), "tanh", generator, normalizer=None)
    components = load_components(saved(policy, critic=critic, dynamics=wrapped, value=value))
    assert set(components) == {"critic"}
    architecture, weights = components["critic"]
    assert (architecture.members, architecture.in_dim, architecture.hidden) == (2, 10, (8,))
    assert torch.equal(weights["ensemble.head.weight"], critic.ensemble.head.weight)


def test_a_policy_of_another_version_is_refused_in_a_line(saved):
    run = saved(scratch_policy(IDP))
    state = load_state(run / "policy.safetensors")
    for broken in ({"blueprint": {"kind": "magic"}}, {"weights": {}}):
        save_state(run / "policy.safetensors", state | broken)
        with pytest.raises(RunDirectoryError, match=r"policy\.safetensors is damaged") as error:
            load_policy(run)
        assert "\n" not in str(error.value)


def test_only_a_network_or_a_policy_around_one_is_the_core_of_a_blueprint(saved, full_core):
    run = saved(wrap(full_core, IDP))
    state = load_state(run / "policy.safetensors")
    for core in (
        scratch_policy(IDP).blueprint(),
        {"kind": "sandwich"},
        {"kind": "paper", "core": 1},
        {**state["blueprint"], "core": []},
    ):
        save_state(run / "policy.safetensors", state | {"blueprint": {**state["blueprint"], "core": core}})
        with pytest.raises(RunDirectoryError, match=r"policy\.safetensors is damaged") as error:
            load_policy(run)
        assert "\n" not in str(error.value)
