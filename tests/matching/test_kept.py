"""A policy keeps the match that it began with; what earlier versions saved without one is matched as they did."""

import json
from dataclasses import replace

import numpy as np
import pytest

from transferkit import load_policy, run_training, wrap
from transferkit.config import TrainConfig, with_settings
from transferkit.envs import derive_spec
from transferkit.errors import RunDirectoryError
from transferkit.files import write_json
from transferkit.matching import earlier_match
from transferkit.policy.blueprints import build
from transferkit.reading import FormatError

ONE, TWO, HOPPER, WALKER = "InvertedPendulum-v5", "InvertedDoublePendulum-v5", "Hopper-v5", "Walker2d-v5"


def test_a_saved_policy_acts_by_its_own_match_whatever_would_be_found_today(untrained_core):
    policy = wrap(untrained_core, TWO, angles="carried", hold=3)
    blueprint = json.loads(json.dumps(policy.blueprint()))
    again = build(blueprint)
    again.load_state_dict(policy.state_dict())
    observation = np.random.default_rng(0).normal(size=(9, 9)).astype(np.float32)
    np.testing.assert_array_equal(again.act(observation), policy.act(observation))
    assert (again.hold, "+0.25 atan2(hinge_y2.sin, hinge_y2.cos)" in again.describe()) == (3, True)


@pytest.mark.parametrize("change", [{"copies": 2}, {"hold": 0}, {"bias": (0.0,)}, {"sin": (99, 1)}, {"form": ("tan",) * 4}])
def test_a_match_that_does_not_fit_its_policy_is_refused(untrained_core, change):
    blueprint = json.loads(json.dumps(wrap(untrained_core, TWO).blueprint()))
    with pytest.raises(FormatError):
        build({**blueprint, "match": {**blueprint["match"], **change}})


def test_one_of_before_is_matched_joint_by_joint_as_it_was():
    match = earlier_match(derive_spec(HOPPER), derive_spec(WALKER))
    assert [len(match.pairing.copies), match.hold, match.pairing.forces] == [1, 1, "acceleration"]
    driven = np.any(match.action_weight, axis=1)
    assert driven.tolist() == [True, True, True, False, False, False]
    assert match.action_weight[0][0] == pytest.approx(match.pairing.length * 183.4715 / 1210.6153)


def test_an_interrupted_run_of_before_goes_on_with_the_match_that_it_had(tmp_path):
    config = TrainConfig(TWO, core="inverted-pendulum-v1", steps=60, eval_episodes=1)
    config = with_settings(config, {"ppo.rollout_steps": 20, "ppo.batch_size": 20})
    run_training(config, out=tmp_path)
    record = json.loads((tmp_path / "run.json").read_text())
    blueprint = record["config"]["policy"]
    del blueprint["match"]
    for spec in (blueprint["source"], blueprint["target"]):
        for joint in spec["joints"]:
            for name in ("body", "anchor", "mass", "range", "reference"):
                del joint[name]
    write_json(tmp_path / "run.json", {**record, "config": {**record["config"], "policy": blueprint}})
    result = run_training(replace(config, steps=80), out=tmp_path, resume=True)
    assert result.steps == 80
    assert load_policy(tmp_path).hold == 1
    with pytest.raises(RunDirectoryError, match=r"wrap.angles"):
        run_training(with_settings(replace(config, steps=99), {"wrap.angles": "carried"}), out=tmp_path, resume=True)
