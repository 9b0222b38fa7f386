import json
from dataclasses import replace

import gymnasium
import numpy as np
import onnxruntime
import pytest

from transferkit import evaluate, export_onnx, load_subject
from transferkit.errors import ConfigError


def test_an_exported_policy_plays_the_bare_environment(tmp_path):
    subject = load_subject("inverted-pendulum-v1")
    assert export_onnx(subject, tmp_path / "policy.onnx") < 1e-4
    session = onnxruntime.InferenceSession(tmp_path / "policy.onnx")
    about = session.get_modelmeta().custom_metadata_map
    assert json.loads(about["observation_names"])[0] == "slide_x_position"
    assert json.loads(about["action_high"]) == [3.0]
    assert json.loads(about["env"]) == "InvertedPendulum-v5"
    assert json.loads(about["joint_names"]) == ["slider"]
    assert json.loads(about["observation_spec"])[1]["joints"] == ["hinge_y"]
    assert json.loads(about["control_period"]) == 0.04
    (again,) = session.run(["action"], {"observation": np.array(json.loads(about["known_input"]), np.float32)})
    np.testing.assert_allclose(again, json.loads(about["known_output"]), rtol=1e-5)
    env = gymnasium.make("InvertedPendulum-v5")  # not ours: controls in newtons, float64 observations
    observation, _ = env.reset(seed=1)
    total, done = 0.0, False
    while not done:
        (action,) = session.run(["action"], {"observation": observation[None].astype(np.float32)})
        assert np.abs(action).max() <= 3.0
        observation, reward, terminated, truncated, _ = env.step(action[0])
        total, done = total + reward, terminated or truncated
    assert total == 1000
    assert evaluate(subject.policy, "InvertedPendulum-v5", episodes=1).mean == 1000
    with pytest.raises(ConfigError, match="exists; choose another out"):
        export_onnx(subject, tmp_path / "policy.onnx")


def test_a_policy_whose_actions_are_not_clipped_is_exported_so(tmp_path):
    subject = load_subject("inverted-pendulum-v1")
    observation = np.array([[0.0, 3.0, 0.0, 9.0]], np.float32)
    limits = {}
    for clip in (True, False):
        path = tmp_path / f"{clip}.onnx"
        export_onnx(replace(subject, clip_actions=clip), path)
        (action,) = onnxruntime.InferenceSession(path).run(["action"], {"observation": observation})
        limits[clip] = float(np.abs(action).max())
    assert limits[True] == 3.0 < limits[False]


def test_angles_are_the_same_on_the_axes(tmp_path):
    subject = load_subject("inverted-pendulum-v1", env="dm_control/cartpole-balance-v0")
    export_onnx(subject, tmp_path / "policy.onnx")
    turns = [(-1.0, 0.0), (-1.0, -0.0), (0.0, 1.0), (-0.0, 1.0), (0.0, -1.0), (1.0, 0.0), (1.0, -0.0)]  # cosine, sine
    observation = np.array([(0.1, *turn, 0.2, 0.1) for turn in turns], np.float32)
    (action,) = onnxruntime.InferenceSession(tmp_path / "policy.onnx").run(["action"], {"observation": observation})
    np.testing.assert_allclose(action, subject.policy.act(observation).clip(-1.0, 1.0), atol=1e-5)
