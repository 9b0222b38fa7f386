import torch

from transferkit import wrap
from transferkit.config import DynaConfig, ModelConfig
from transferkit.nn import Ensemble
from transferkit.policy.critic_and_model import make_critic, make_dynamics
from transferkit.policy.wrapped_ensemble import learning_parts, thaw
from transferkit.streams import Streams

TWO, THREE, HIDDEN = DynaConfig(critics=2), ModelConfig(members=3), (16, 16)


def generator():
    return Streams(0).torch("test")


def test_a_wrapped_critic_on_its_own_source_is_the_cores(full_core):
    policy = wrap(full_core, full_core.spec)
    critic = make_critic(policy, TWO, HIDDEN, generator(), wrapped=True)
    observation, action = torch.randn(7, 4, generator=Streams(0).torch("x")), torch.full((7, 1), 0.3)
    torch.testing.assert_close(critic(observation, action), full_core.critic()(observation, action))
    assert isinstance(make_critic(policy, TWO, HIDDEN, generator()).ensemble, Ensemble)


def test_a_core_with_another_number_of_members_is_not_wrapped_and_that_is_said(full_core, caplog):
    policy = wrap(full_core, full_core.spec)
    assert isinstance(make_critic(policy, DynaConfig(critics=5), HIDDEN, generator(), wrapped=True).ensemble, Ensemble)
    assert "wrap.critic has no effect" in caplog.text
    assert isinstance(make_dynamics(policy, full_core.spec, ModelConfig(members=5), generator()).ensemble, Ensemble)
    assert not isinstance(make_dynamics(policy, full_core.spec, THREE, generator()).ensemble, Ensemble)


def test_a_wrapped_core_learns_at_the_policys_rate_for_it_and_stays_while_it_is_frozen(full_core):
    policy = wrap(full_core, full_core.spec, lr_scale={"core": 0.2}, freeze={"core": 0.5})
    critic = make_critic(policy, TWO, HIDDEN, generator(), wrapped=True)
    parts = learning_parts(critic, policy)
    assert [part.lr_scale for part in parts] == [1.0, 0.2]
    counted = [parameter for part in parts for parameter in part.parameters]
    assert {id(p) for p in counted} == {id(p) for p in critic.parameters()}
    assert len(counted) == len({id(p) for p in counted})
    for progress, learns in ((0.4, False), (0.5, True)):
        thaw(critic, policy, progress)
        assert all(parameter.requires_grad == learns for parameter in parts[1].parameters)
        assert all(parameter.requires_grad for parameter in parts[0].parameters)


def test_a_model_of_states_is_that_of_the_paper(full_core):
    policy = wrap(full_core, full_core.spec)
    model = make_dynamics(policy, full_core.spec, ModelConfig(predict="state", members=1), generator(), wrapped=False)
    observation, action = torch.randn(3, 4, generator=Streams(0).torch("x")), torch.zeros(3, 1)
    mean, _, _ = model(observation, action)
    torch.testing.assert_close(model.predict(observation, action).next_observation, mean[..., :4])
