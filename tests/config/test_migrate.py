"""Records of earlier versions become configurations of this one."""

import pytest

from tests.config.records import old_record
from transferkit.config import TrainConfig, identity, migrated_blueprint, overrides
from transferkit.errors import ConfigError, SettingError
from transferkit.zoo.card import read_card
from transferkit.zoo.catalog import core_folders

CARDS = core_folders()
PPO_V1 = {"rollout": "steps", "schedule": "linear", "desired_kl": 0.01, "critic_learning_rate": None}


@pytest.mark.parametrize(
    ("algo", "preset", "version"),
    [
        ("ppo", "default", "default-v2"),
        ("ppo", "paper", "paper-v1"),
        ("dyna-ddpg", "default", "default-v1"),
        ("dyna-ddpg", "paper", "paper-v1"),
        ("dyna-ppo", "default", "default-v1"),
    ],
)
@pytest.mark.parametrize("core", [None, "inverted-pendulum-v1"])
def test_a_run_of_a_preset_is_todays_run_of_that_version(algo, preset, version, core):
    record = old_record(preset, algo=algo, core=core)
    budget = {name: record[name] for name in ("steps", "episodes", "eval_every", "eval_episodes")}
    today = TrainConfig("Hopper-v5", algo=algo, preset=version, core=core, **budget)
    config = TrainConfig.from_json(record)
    assert config.preset == version
    assert overrides(config) == {}
    assert identity(config) == identity(today)


def test_ppo_as_it_was_before_its_second_version_is_known_by_its_settings():
    record = old_record("default", ppo=PPO_V1)
    assert identity(TrainConfig.from_json(record)) == identity(
        TrainConfig("Hopper-v5", preset="default-v1", steps=3000, eval_every=1000, eval_episodes=3)
    )
    del record["ppo"]["critic_learning_rate"]  # records before there was one
    del record["dyna"]
    assert TrainConfig.from_json(record).preset == "default-v1"


def test_settings_of_their_own_move_with_their_owner():
    ppo = {"hidden": [32], "std": "head", "init_std": 0.5, "clip_actions": False, "gamma": 0.98}
    dyna = {
        "hidden": [16, 16],
        "squash": True,
        "exploration_noise": 0.2,
        "model_members": 3,
        "predict": "state",
        "wrap_critic": True,
        "ppo_horizon": 8,
        "buffer_size": 500,
    }
    core = "inverted-pendulum-v1"
    assert overrides(TrainConfig.from_json(old_record("default", core=core, ppo=ppo, dyna=dyna))) == {
        "env_config.clip_actions": False,
        "network.hidden": [32],
        "network.std": "head",
        "network.init_std": 0.5,
        "network.initialization": "paper",  # a head implied it
        "ppo.gamma": 0.98,
        "wrap.init_std": 0.5,
        "wrap.critic": True,
    }
    assert overrides(TrainConfig.from_json(old_record("default", algo="dyna-ddpg", ppo=ppo, dyna=dyna))) == {
        "env_config.clip_actions": False,
        "network.hidden": [16, 16],
        "network.init_std": 0.2,
        "network.squash": True,
        "dyna.exploration_noise": 0.2,
        "dyna.buffer_size": 500,
        "model.members": 3,
        "model.predict": "state",
    }
    found = overrides(TrainConfig.from_json(old_record("default", algo="dyna-ppo", ppo=ppo, dyna=dyna)))
    assert found["dyna_ppo.horizon"] == 8
    assert found["dyna_ppo.buffer_size"] == 500
    assert found["model.members"] == 3
    assert found["network.hidden"] == [32]


@pytest.mark.parametrize("broken", [{"ppo": None}, {"ppo": {}}, {"network": {}}, {"network": None}], ids=str)
def test_what_no_version_wrote_is_refused_in_a_line(broken):
    with pytest.raises(ConfigError, match="does not hold a configuration of this version") as error:
        TrainConfig.from_json({**old_record("default"), **broken})
    assert "\n" not in str(error.value)


def test_what_no_version_can_run_is_refused_in_a_line():
    with pytest.raises(SettingError, match=r"model\.loss='squared-error' must be 'likelihood'") as error:
        TrainConfig.from_json(old_record("paper", algo="dyna-ppo"))
    assert "\n" not in str(error.value)


@pytest.mark.parametrize("core", CARDS)
def test_the_configuration_on_every_released_card_is_read(core):
    card = read_card(CARDS[core])
    config = TrainConfig.from_json(card.config)
    presets = {
        "swimmer-v1": "default-v3",
        "hopper-v1": "default-v2",
        "walker2d-v1": "default-v2",
        "half-cheetah-v1": "default-v4",
        "reacher-v1": "default-v3",
        "hopper-family-v1": "default-v7",
        "hopper-stand-v1": "default-v7",
        "inverted-pendulum-family-v1": "default-v7",
        "walker-stand-v1": "default-v7",
        "walker-walk-v1": "default-v2",
    }
    assert config.preset == presets.get(core, "default-v1")
    assert config.network.hidden == tuple(card.components["policy"].architecture["hidden"])


def test_a_blueprint_whose_head_implied_the_papers_initialisation_says_so():
    head = {"kind": "scratch", "architecture": {"std": "head", "initialization": "orthogonal"}}
    assert migrated_blueprint(head)["architecture"] == {"std": "head", "initialization": "paper"}
    for today in ({"kind": "constant"}, {"architecture": {"std": "parameter", "initialization": "orthogonal"}}):
        assert migrated_blueprint(today) == today
