"""A student that sees less: what it learns from, what it reaches, and what a killed process leaves."""

from dataclasses import asdict

import gymnasium
import numpy as np
import pytest
import torch

from tests.cli.commands import run, run_json
from transferkit import evaluate, load_core
from transferkit.distillation import DistillConfig, distill
from transferkit.distillation.student import imitation_loss
from transferkit.distillation.teacher import watch
from transferkit.errors import ArtifactError, ConfigError, RunDirectoryError, SettingError

BLIND = "InvertedPendulum-v5?max_episode_steps=100&vary.drop_observation=[2,3]&vary.frames=3"
"""Without velocities, but with three frames."""
QUICK = {"steps": 1500, "rounds": 3, "hidden": (32,), "batch": 64, "members": (0,)}


@pytest.fixture(autouse=True)
def folder(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)


def scaled_outside():
    return gymnasium.wrappers.RescaleAction(gymnasium.make("InvertedPendulum-v5"), -1.0, 1.0)


def test_what_lies_beyond_a_limit_is_no_error():
    mean = torch.tensor([[1.5, -2.0, 1.5, 0.5]])
    wanted = torch.tensor([[1.0, -1.0, 0.5, 1.0]])
    assert float(imitation_loss(mean, wanted)) == pytest.approx((0 + 0 + 1.0 + 0.25) / 4)


def test_the_teacher_sees_what_the_student_does_not():
    made, watched = watch(BLIND)
    first = made.reset(seed=3)[0]
    assert (first.shape, watched.latest.shape) == ((6,), (4,))
    plain = gymnasium.make("InvertedPendulum-v5")
    expected = plain.reset(seed=3)[0]
    for action in (0.3, -0.7):
        np.testing.assert_allclose(watched.latest, expected, rtol=1e-6)
        made.step(np.array([action], np.float32))
        expected = plain.step(np.array([3 * action]))[0]


def test_a_pole_is_held_without_its_velocities(capsys):
    flags = "--steps", "4000", "--rounds", "5", "--members", "0", "2", "--threshold", "95"
    said = run_json(capsys, "distill", "inverted-pendulum-v2", "--env", BLIND, "--name", "blind", *flags)
    assert said["id"] == "blind-v1"
    assert min(said["members"]) > 95
    assert said["teacher"] == [100.0, 100.0]
    core = load_core("zoo/blind-v1")
    assert [element.age for element in core.spec.observation] == [2, 2, 1, 1, 0, 0]
    assert len(core.seeds) == 2
    assert evaluate(core.policy(1), BLIND, episodes=3).mean > 95
    code, out, _ = run(capsys, "zoo", "verify", "zoo/blind-v1", "--rollout")
    assert (code, "rolled out" in out) == (0, True)
    assert "Licence: MIT.\n" in run(capsys, "zoo", "show", "zoo/blind-v1")[1]


def test_a_killed_call_goes_on_to_the_bit():
    def stop(spent, _):
        if spent.steps == 1000:
            raise KeyboardInterrupt

    whole = distill("inverted-pendulum-v2", BLIND, DistillConfig("whole", **QUICK))
    with pytest.raises(KeyboardInterrupt):
        distill("inverted-pendulum-v2", BLIND, DistillConfig("cut", **QUICK), report=stop)
    with pytest.raises(RunDirectoryError, match="of another distillation of this name; delete it"):
        distill("inverted-pendulum-v2", BLIND, DistillConfig("cut", **QUICK | {"lr": 1e-4}))
    cut = distill("inverted-pendulum-v2", BLIND, DistillConfig("cut", **QUICK))
    assert cut.card.files == whole.card.files
    assert asdict(cut.card.score) == asdict(whole.card.score)
    assert cut.card.spent[0]["steps"] == 1500


def test_what_cannot_be_distilled_is_one_line(capsys):
    with pytest.raises(ConfigError, match="so a teacher there has others than its student; leave out what changes actions"):
        distill("inverted-pendulum-v2", scaled_outside, DistillConfig("a", **QUICK))
    with pytest.raises(ArtifactError, match="below the threshold 2000; give more steps"):
        distill("inverted-pendulum-v2", BLIND, DistillConfig("b", threshold=2000, **QUICK))
    with pytest.raises(SettingError, match="steps=10 must be at least 5 in each of 3 rounds"):
        DistillConfig("c", steps=10, rounds=3)
    with pytest.raises(SettingError, match=r"members=\(0, 0\) must be different from each other"):
        DistillConfig("c", members=(0, 0))
    code, _, said = run(capsys, "distill", "inverted-pendulum-v2", "--env", BLIND)
    assert (code, said.count("\n")) == (2, 1)
    assert "a student needs a name and an environment" in said
    code, _, said = run(capsys, "distill", "no-such-core", "--env", BLIND, "--name", "d")
    assert (code, "unknown run or core" in said or "unknown core" in said) == (2, True)
