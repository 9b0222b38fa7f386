from dataclasses import asdict, replace

import pytest

from transferkit.config import DynaConfig, PPOConfig, TrainConfig, WrapConfig, identity, overrides, with_settings
from transferkit.errors import ConfigError, SettingError, UnknownNameError

ENV = "Hopper-v5"


def test_a_preset_fills_what_is_left_out_and_its_version_is_recorded():
    config = TrainConfig(ENV, preset="paper", steps=10, ppo=PPOConfig(gamma=0.9))
    assert config.preset == "paper-v1"
    assert config.network.hidden == (128, 128)
    assert config.ppo == PPOConfig(gamma=0.9)
    assert not config.env_config.clip_actions


def test_a_record_is_its_configuration():
    config = TrainConfig(ENV, wrap=WrapConfig(freeze={"core": 0.5}), experience=("a.mcap",), algo="dyna-ddpg")
    record = {**asdict(config), "policy": {}}
    assert TrainConfig.from_json(record) == config
    del record["experience"]
    assert TrainConfig.from_json(record) == replace(config, experience=())


def test_overrides_are_what_the_run_reads_and_the_preset_does_not_say():
    config = with_settings(
        TrainConfig(ENV), {"ppo.gamma": 0.98, "network.hidden": [32, 32], "dyna.anchor": 0.0, "wrap.residual": 8}
    )
    assert overrides(config) == {"network.hidden": [32, 32], "ppo.gamma": 0.98}  # no trainer that reads `dyna`, no core to wrap
    with_core = replace(config, core="inverted-pendulum-v1")
    assert overrides(with_core) == {"network.hidden": [32, 32], "ppo.gamma": 0.98, "wrap.residual": 8}
    assert overrides(replace(config, algo="dyna-ddpg", preset="default"))["dyna.anchor"] == 0.0


def test_identity_is_the_version_the_overrides_and_what_is_given():
    config = TrainConfig(ENV, steps=100, seed=3, checkpoint_seconds=1.0)
    assert identity(config) == {
        "env": ENV,
        "seed": 3,
        "steps": 100,
        "eval_episodes": 20,
        "eval_every": 0,
        "algo": "ppo",
        "preset": "default-v8",
    }
    same = replace(config, checkpoint_seconds=9.0, member=2, dyna=DynaConfig(gamma=0.5))
    assert identity(same) == identity(config)
    core = replace(config, core="a-v1", member=2, device="cuda", wrap=replace(config.wrap, residual=0))
    more = {"core": "a-v1", "member": 2, "device": "cuda", "overrides": {"wrap.residual": 0}}
    assert identity(core) == identity(config) | more
    for other in (
        {"seed": 4},
        {"steps": 101},
        {"preset": "default-v1"},
        {"eval_every": 10},
        {"eval_every": 10, "stop_at": 1.0},
    ):
        assert identity(replace(config, **other)) != identity(config), other


def test_settings_are_set_by_dotted_name():
    config = TrainConfig(ENV, algo="dyna-ddpg")
    changed = with_settings(
        config, {"dyna.discount_seconds": "none", "dyna.gamma": 0.9, "network.hidden": [8], "wrap.freeze": {"core": 1.0}}
    )
    assert changed.dyna == replace(config.dyna, discount_seconds=None, gamma=0.9)
    assert changed.network.hidden == (8,)
    assert changed.wrap.freeze == {"core": 1.0}
    assert with_settings(config, {}) == config


def test_settings_that_need_each_other_are_set_together():
    settings = {"ppo.num_envs": 256, "ppo.rollout_steps": 512}
    assert with_settings(TrainConfig(ENV), settings).ppo.num_envs == 256
    with pytest.raises(SettingError, match=r"ppo\.rollout_steps=128 must be at least ppo\.num_envs=256"):
        with_settings(TrainConfig(ENV), {"ppo.num_envs": 256})


@pytest.mark.parametrize(
    ("settings", "message"),
    [
        ({"ppo.gama": 0.9}, r"unknown setting 'ppo.gama'; did you mean ppo.gamma"),
        ({"gamma": 0.9}, "unknown setting 'gamma'"),
        ({"poo.gamma": 0.9}, "did you mean ppo.gamma"),
    ],
    ids=["key", "no section", "section"],
)
def test_an_unknown_setting_is_refused_with_the_nearest(settings, message):
    with pytest.raises(UnknownNameError, match=message):
        with_settings(TrainConfig(ENV), settings)


@pytest.mark.parametrize(
    ("options", "message"),
    [
        pytest.param({"algo": "pop"}, r"unknown trainer 'pop'; did you mean ppo\?", id="trainer"),
        pytest.param({"preset": "papr"}, "unknown preset of ppo 'papr'; did you mean paper", id="preset"),
        pytest.param({"steps": 0}, "^steps=0 must be at least 1", id="budget"),
        pytest.param({"seed": -1}, "^seed=-1 must be at least 0", id="seed"),
        pytest.param({"eval_episodes": 0}, "^eval_episodes=0 must be at least 1", id="evaluation"),
        pytest.param({"stop_at": 3.0}, r"^stop_at=3 is compared with evaluations; give eval_every too", id="stop_at alone"),
        pytest.param({"experience": ("x.mcap",)}, r"^ppo does not learn from recordings; use algo=dyna-ddpg", id="experience"),
        pytest.param({"mapping": "x.toml"}, r"^mapping=x.toml has no recordings to read; give experience", id="mapping alone"),
    ],
)
def test_a_run_that_contradicts_itself_is_refused(options, message):
    with pytest.raises((ConfigError, UnknownNameError), match=message):
        TrainConfig(ENV, **options)


@pytest.mark.parametrize(
    ("algo", "settings", "message"),
    [
        pytest.param("dyna-ddpg", {"dyna.gamma": 1.0}, "dyna.gamma=1.0 must be at least 0 and below 1", id="gamma"),
        pytest.param(
            "dyna-ddpg", {"dyna.model_share": 1.5}, "dyna.model_share=1.5 must be at least 0 and at most 1", id="share"
        ),
        pytest.param("dyna-ddpg", {"dyna.discount_seconds": 0.0}, "dyna.discount_seconds=0.0 must be above 0", id="seconds"),
        pytest.param("dyna-ppo", {"dyna_ppo.horizon": 0}, "dyna_ppo.horizon=0 must be at least 1", id="horizon"),
        pytest.param("dyna-ddpg", {"model.loss": "squared-error"}, "which learns rewards and terminations", id="loss"),
        pytest.param(
            "dyna-ppo", {"model.loss": "squared-error"}, "which learns rewards and terminations", id="loss of dyna-ppo"
        ),
        pytest.param("ppo", {"ppo.rollout": "episode"}, "ppo.num_envs=4 must be 1 if ppo.rollout is 'episode'", id="episodes"),
        pytest.param(
            "ppo", {"ppo.learning_rate": 0.1}, "ppo.learning_rate=0.1 must be at least 1e-05 and at most 0.01 if", id="rate"
        ),
        pytest.param(
            "ppo", {"wrap.freeze": {"core": 2.0}}, "wrap.freeze.core=2.0 must be at least 0 and at most 1", id="freeze"
        ),
        pytest.param("ppo", {"wrap.lr_scale": {"core": 0.0}}, "wrap.lr_scale.core=0.0 must be above 0", id="lr_scale"),
    ],
)
def test_impossible_settings_are_refused(algo, settings, message):
    with pytest.raises(SettingError, match=message):
        with_settings(TrainConfig(ENV, algo=algo), settings)


def test_the_papers_model_goes_with_its_rewards():
    learns_nothing_else = {
        "model.loss": "squared-error",
        "dyna.planned_reward": "minus-norm",
        "dyna.planned_termination": False,
    }
    assert with_settings(TrainConfig(ENV, algo="dyna-ddpg"), learns_nothing_else).model.loss == "squared-error"


def test_the_discount_follows_the_time_step():
    assert DynaConfig(discount_seconds=2.0).discount(0.02) == pytest.approx(0.99005, abs=1e-5)
    assert DynaConfig(discount_seconds=None, gamma=0.9).discount(0.02) == 0.9
    assert DynaConfig(gamma=0.9).discount(0.0) == 0.9
