import numpy as np
from gymnasium.envs.mujoco import MujocoEnv
from gymnasium.spaces import Box

from transferkit.envs import derive_spec

XML = """
<mujoco>
  <worldbody>
    <body><joint name="lift" type="slide" axis="0 0 -1"/><geom size=".1" pos="0 0 -.2"/>
      <body><joint name="twist" type="hinge" axis="0 -1 0"/><geom size=".1" pos="0 0 -.5"/></body></body>
  </worldbody>
  <actuator><motor name="hoist" joint="lift" gear="-7" ctrlrange="-2 3" ctrllimited="true"/></actuator>
</mujoco>
"""


class Crane(MujocoEnv):
    """A user's own environment, with every kind of element."""

    metadata = {"render_modes": ["human", "rgb_array", "depth_array", "rgbd_tuple"], "render_fps": 50}  # noqa: RUF012

    def __init__(self, path):
        super().__init__(str(path), 10, Box(-np.inf, np.inf, (8,)))

    def _get_obs(self):
        (lift, twist), (v, w) = self.data.qpos, self.data.qvel
        product = lift * np.sin(twist)
        return np.array([2 * lift + 1, -np.sin(twist), np.cos(twist), v, -w, product, self.data.qfrc_actuator[0], 3.0])

    def reset_model(self):
        self.set_state(self.init_qpos, self.init_qvel)
        return self._get_obs()

    def step(self, action):
        self.do_simulation(action, self.frame_skip)
        return self._get_obs(), 0.0, False, False, {}


def test_a_users_own_environment(tmp_path):
    path = tmp_path / "crane.xml"
    path.write_text(XML)
    spec = derive_spec(Crane(path))
    lift, twist = spec.joints
    assert (lift.name, lift.model_name, lift.axis, lift.parent) == ("slide_z", "lift", (0, 0, -1), None)
    assert (twist.name, twist.axis, twist.parent, twist.rest, twist.length) == (
        "hinge_y",
        (0, -1, 0),
        "slide_z",
        (0, 0, -1),
        0.5,
    )
    got = [(e.quantity, e.joints, e.coefficients, e.offset) for e in spec.observation]
    assert got == [
        ("position", ("slide_z",), (2.0,), 1.0),
        ("sin", ("hinge_y",), (-1.0,), 0.0),
        ("cos", ("hinge_y",), (1.0,), 0.0),
        ("velocity", ("slide_z",), (1.0,), 0.0),
        ("velocity", ("hinge_y",), (-1.0,), 0.0),
        ("function of position", ("slide_z", "hinge_y"), (), 0.0),
        ("force", (), (), 0.0),
        ("constant", (), (), 0.0),
    ]
    (hoist,) = spec.action
    assert (hoist.joint, hoist.low, hoist.high, hoist.gear, hoist.unit) == ("slide_z", -2.0, 3.0, -7.0, "N")
    mass = 2 * 1000 * 4 / 3 * np.pi * 0.1**3  # both balls move with the lift; mujoco's default density
    np.testing.assert_allclose(hoist.authority, -7 * 2.5 / mass, rtol=1e-3)


def test_sums_of_angles_and_heights_are_recognised():
    acrobot = derive_spec("dm_control/acrobot-swingup-v0").observation
    assert acrobot[1].joints == ("hinge_y", "hinge_y2")
    assert acrobot[1].coefficients == (1.0, 1.0)
    humanoid = derive_spec("dm_control/humanoid-walk-v0").observation
    assert [e.name for e in humanoid if e.quantity == "height"] == ["head.height"]
