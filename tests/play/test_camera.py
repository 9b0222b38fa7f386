import mujoco
import numpy as np
import pytest

from tests.toys import Counter
from transferkit.errors import EnvironmentContractError
from transferkit.play.camera import Camera, camera_of

BODY = '<body><freejoint/><geom size=".1"/>{}</body>'
FIXED, FOLLOWING = "<camera/>", '<camera mode="trackcom"/>'


@pytest.mark.parametrize(("cameras", "chosen"), [("", -1), (FIXED, 0), (FIXED * 2 + FOLLOWING, 2), (FOLLOWING + FIXED, 0)])
def test_the_camera_follows_the_robot_if_one_does(cameras, chosen):
    xml = f"<mujoco><worldbody>{BODY.format(cameras)}</worldbody></mujoco>"
    assert camera_of(mujoco.MjModel.from_xml_string(xml)) == chosen


class Drawn(Counter):
    """Draws itself, all in one grey."""

    render_mode = "rgb_array"

    def render(self):
        return np.full((20, 30, 3), 7, np.uint8)


def test_an_environment_that_is_not_mujoco_draws_itself_or_is_refused():
    assert Camera(Drawn(3)).picture().tolist() == np.full((20, 30, 3), 7).tolist()
    with pytest.raises(EnvironmentContractError, match="Counter is not a MuJoCo environment, and draws no pictures"):
        Camera(Counter(3)).picture()
