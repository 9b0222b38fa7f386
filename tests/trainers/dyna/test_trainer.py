from dataclasses import replace

import numpy as np
import pytest
import torch

from tests.runs import interrupt_at
from transferkit import load_policy, run_training, wrap
from transferkit.config import TrainConfig, with_settings
from transferkit.envs import derive_spec
from transferkit.errors import DivergedError, InterruptedRunError
from transferkit.policy.critic_and_model import make_dynamics
from transferkit.run import EpisodeRow, Session, load_state, read_table, save_state
from transferkit.streams import Streams
from transferkit.trainers.dyna.kept import Kept

IDP = "InvertedDoublePendulum-v5"
TINY = {
    "network.hidden": [16, 16],
    "model.hidden": [16],
    "model.updates": 60,
    "dyna.updates_per_step": 2,
    "dyna.batch_size": 32,
    "dyna.model_share": 0.5,
}
SMALL = with_settings(TrainConfig(IDP, algo="dyna-ddpg", steps=400, eval_episodes=1, checkpoint_seconds=0.0), TINY)


def test_the_paper_preset_runs_past_the_end_of_its_first_episode(tmp_path):
    config = TrainConfig(IDP, algo="dyna-ddpg", preset="paper", episodes=3, eval_episodes=1)
    run_training(with_settings(config, {"network.hidden": [16, 16], "model.hidden": [16, 16]}), out=tmp_path / "run")
    lengths = read_table(tmp_path / "run", EpisodeRow)["length"].tolist()
    assert lengths[0] >= 128
    assert max(lengths[1:]) < 128


def test_diverging_values_stop_the_run_and_keep_the_last_good_checkpoint(tmp_path):
    """The critics of a checkpoint are made to promise a million."""
    checkpoint = tmp_path / "run/checkpoint.safetensors"
    with pytest.raises(InterruptedRunError):
        run_training(SMALL, out=tmp_path / "run", report=interrupt_at(200))
    state = load_state(checkpoint)
    for name in ("critic", "target_critic"):
        state["trainer"]["modules"][name]["ensemble.head.bias"].fill_(1e6)
    save_state(checkpoint, state)
    with pytest.raises(
        DivergedError, match=r"at environment step 300.*last good checkpoint.*lower dyna.critic_learning_rate or"
    ):
        run_training(SMALL, out=tmp_path / "run", resume=True)
    assert load_state(checkpoint)["session"]["spent"][1] == 200


def test_no_reward_yet_is_no_divergence(tmp_path):
    config = replace(SMALL, env="dm_control/pendulum-swingup-v0", steps=300)
    assert run_training(config, out=tmp_path / "run").steps == 300


def test_a_wrapped_model_trains_on_another_robot(full_core, full_core_folder, tmp_path):
    settings = {"model.members": 3, "dyna.keep_peak": False}  # a peak may be before the model's first fit
    config = with_settings(replace(SMALL, core=str(full_core_folder)), settings)
    before = make_dynamics(wrap(full_core, IDP), derive_spec(IDP), config.model, Streams(0).torch("x")).state_dict()
    run_training(config, out=tmp_path / "run")
    saved = load_state(tmp_path / "run/policy.safetensors")["parts"]["dynamics"]["weights"]
    assert saved.keys() == before.keys()
    assert not torch.equal(saved["ensemble.core.body.0.weight"], before["ensemble.core.body.0.weight"])


ONES = np.full((1, 9), 0.1, np.float32)


def with_peak(core, folder, *, keeps):
    config = replace(SMALL, core=str(folder)) if core else SMALL
    return with_settings(
        config, {"wrap.probation": 0, "wrap.fall_back": False, "wrap.least_gain": 0.0, "dyna.keep_peak": keeps}
    )


@pytest.fixture
def peaks(monkeypatch):
    """What the policy of each peak did."""
    found, remember = [], Kept.remember

    def spied(kept):
        remember(kept)
        found.append(kept._modules["policy"].act(ONES))

    monkeypatch.setattr(Kept, "remember", spied)
    return found


@pytest.mark.parametrize("core", [False, True])
def test_a_run_ends_with_the_policy_of_its_best_stretch_and_learns_as_if_it_did_not(core, full_core_folder, tmp_path, peaks):
    returns, ends = [], []
    for keeps in (False, True):
        run_training(with_peak(core, full_core_folder, keeps=keeps), out=tmp_path / str(keeps))
        returns.append(read_table(tmp_path / str(keeps), EpisodeRow)["return"])
        ends.append(load_policy(tmp_path / str(keeps)).act(ONES))
    assert returns[0].tolist() == returns[1].tolist()
    means = [returns[1][k : k + 5].mean() for k in range(len(returns[1]) - 4)]
    assert np.argmax(means) < len(means) - 1  # the last is not the best
    assert not np.allclose(*ends, atol=1e-4)
    np.testing.assert_allclose(ends[1], peaks[-1], atol=1e-6)


def test_what_is_learnt_is_followed_to_the_end_until_episodes_say_that_it_was_better(full_core_folder, tmp_path, monkeypatch):
    monkeypatch.setattr("transferkit.run.session.LATEST", 500)  # more than there are
    for keeps in (False, True):
        run_training(with_peak(core=True, folder=full_core_folder, keeps=keeps), out=tmp_path / str(keeps))
    ends = [load_policy(tmp_path / str(keeps)) for keeps in (False, True)]
    np.testing.assert_array_equal(*(policy.act(ONES) for policy in ends))
    assert int(ends[1].normalizer.count) == 400


def test_what_no_episode_has_tried_is_not_kept(full_core_folder, tmp_path, monkeypatch, peaks):
    monkeypatch.setattr(Session, "is_at_peak", True)
    same = []
    for tried in (False, True):
        config = with_settings(with_peak(core=False, folder=full_core_folder, keeps=True), {"dyna.keep_tried": tried})
        run_training(config, out=tmp_path / str(tried))
        same.append(np.allclose(load_policy(tmp_path / str(tried)).act(ONES), peaks[-1], atol=1e-6))
    assert same == [False, True]
