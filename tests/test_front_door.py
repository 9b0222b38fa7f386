"""What is not what a function of the public interface takes is refused with what to give instead."""

import pytest

from transferkit import Budget, PPOConfig, evaluate, health, load_core, record_episodes, scratch_policy, train, wrap
from transferkit.config import TrainConfig
from transferkit.errors import ConfigError, SettingError, TransferkitError
from transferkit.training import default_directory

IP = "InvertedPendulum-v5"


@pytest.fixture(scope="module")
def policy():
    return scratch_policy(IP)


@pytest.mark.parametrize(
    ("call", "message"),
    [
        (lambda _: wrap("inverted-pendulum-v1", IP), "core is of type str and not Core; get it from load_core"),
        (lambda p: wrap(p, IP), "core is of type ScratchPolicy and not Core"),
        (lambda _: wrap(load_core("inverted-pendulum-v1"), IP, config={}), "config is of type dict and not WrapConfig"),
        (lambda _: wrap(load_core("inverted-pendulum-v1"), IP, seed=10**400), "^seed=10000.*must be at most 9,223"),
        (lambda _: scratch_policy(IP, {"hidden": (8,)}), "network is of type dict and not NetworkConfig; make one"),
        (lambda _: scratch_policy(IP, seed=1.5), "^seed=1.5 must be a whole number"),
        (
            lambda _: train("inverted-pendulum-v1", IP, Budget(steps=9)),
            "policy is of type str and not Policy; make one with wrap",
        ),
        (lambda p: train(p, IP, 20), "budget is of type int and not Budget; give one"),
        (
            lambda p: train(p, 5, Budget(steps=9)),
            "env is of type int; give an id, an environment of Gymnasium or dm_control, or",
        ),
        (lambda p: train(p, IP, Budget(steps=9), settings=PPOConfig()), "settings is of type PPOConfig and not Mapping"),
        (lambda p: train(p, IP, Budget(steps=9), settings={"wrap.residual": 0}), "wrap.residual has no effect on a policy"),
        (lambda p: train(p, IP, Budget(steps=9), settings={"network.std": "head"}), "network.std has no effect on a policy"),
        (lambda p: train(p, IP, Budget(steps=9), settings={"dyna.tau": 1}), "dyna.tau is not a setting of ppo"),
        (lambda p: train(p, IP, Budget(steps=9), algo=3), "^algo=3 must be a string"),
        (lambda _: Budget(episodes="20"), "^episodes='20' must be a whole number"),
        (lambda _: Budget(steps=10**400), "must be at most 9,223"),
        (lambda _: Budget(seconds=float("nan")), "^seconds=nan must be a finite number"),
        (lambda p: evaluate(p, IP, episodes=1, seed=-1), "^seed=-1 must be at least 0"),
        (lambda p: health(p, "Hopper-v5"), "takes 4 observations and 1 actions, environment Hopper-v5 has 11 and 3"),
        (lambda p: record_episodes(p, "x.mcap"), "subject is of type ScratchPolicy and not Subject; load it with load_subject"),
    ],
)
def test_something_else_is_refused(policy, tmp_path, monkeypatch, call, message):
    monkeypatch.chdir(tmp_path)
    with pytest.raises(TransferkitError, match=message) as caught:
        call(policy)
    assert isinstance(caught.value, ConfigError | SettingError)
    assert not list(tmp_path.iterdir())


def test_a_default_directory_has_no_colon():
    path = default_directory(TrainConfig("my_robots:Sine/Pendulum-v0", steps=9, core="a:b"))
    assert str(path) == "runs/my_robots-Sine-Pendulum-v0_a-b.0_ppo_default_seed0"
