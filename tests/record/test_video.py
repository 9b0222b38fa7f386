import numpy as np
import pytest

from transferkit.errors import ConfigError
from transferkit.record.video import frame, video


class Camera:
    """An environment whose frames are noise."""

    def render(self):
        return np.random.default_rng(0).integers(0, 255, (64, 64, 3), np.uint8)


def test_a_video_has_every_frame_or_is_not_there(tmp_path, monkeypatch):
    with video(tmp_path / "x.mp4", 0.04, frame) as add:
        for _ in range(10):
            add(Camera())
    assert [path.name for path in tmp_path.iterdir()] == ["x.mp4"]
    monkeypatch.setattr("imageio_ffmpeg.count_frames_and_secs", lambda _: (3, 0.1))  # the disk was full
    with (
        pytest.raises(ConfigError, match=r"cannot write .*y\.mp4: .*[;?] choose another video"),
        video(tmp_path / "y.mp4", 0.04, frame) as add,
    ):
        add(Camera())
    assert [path.name for path in tmp_path.iterdir()] == ["x.mp4"]
