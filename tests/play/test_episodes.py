"""What is counted and when a play ends, on a toy whose episodes have three steps of unknown length."""

import numpy as np
import pytest

from tests.play.test_camera import Drawn
from transferkit.errors import ConfigError
from transferkit.play.episodes import _Play, play_episodes
from transferkit.policy.base import ConstantPolicy
from transferkit.record.play import Subject
from transferkit.record.video import _frames
from transferkit.streams import Streams

STEPS = 3


def play(episodes, most, watched_until=np.inf):
    seen = []

    def show(moment):
        seen.append((moment.step, moment.seconds, moment.observation[1], moment.last))
        return len(seen) <= watched_until

    playing = _Play(ConstantPolicy(2, 1), Drawn(STEPS), show, 0.5, Streams(0))
    playing.play(episodes, most)
    return seen, [episode.steps for episode in playing.played], playing.whole


def test_every_moment_is_shown_with_the_end():
    seen, steps, whole = play(2, np.inf)
    assert seen == [(0, 0.0, 0, False), (1, 0.5, 1, False), (2, 1.0, 2, False), (3, 1.5, 3, True)] * 2
    assert (steps, whole) == ([3, 3], True)


@pytest.mark.parametrize(
    ("most", "watched", "steps", "whole"),
    [(4, np.inf, [3, 1], False), (3, np.inf, [3], False), (6, np.inf, [3, 3], True), (np.inf, 1, [2], False)],
)
def test_it_ends_with_the_time_or_when_nobody_watches(most, watched, steps, whole):
    assert play(2, most, watched)[1:] == (steps, whole)


@pytest.fixture
def toy():
    return Subject(ConstantPolicy(2, 1), Drawn(STEPS))


def test_a_video_has_a_frame_a_moment_and_is_wider_with_inputs(toy, tmp_path):
    shown = play_episodes(toy, tmp_path / "x.mp4", episodes=2)
    assert ([episode.total for episode in shown.episodes], shown.whole, shown.inputs) == ([3.0, 3.0], True, "")
    assert _frames(tmp_path / "x.mp4") == 2 * (STEPS + 1)
    assert play_episodes(toy, tmp_path / "y.mp4", inputs=True).inputs == "observation"


def test_what_is_no_file_for_a_play(toy, tmp_path):
    (tmp_path / "x.mp4").touch()
    for name, said in (("x.mp4", "exists"), ("x.gif", r"must be \.mp4 or \.png"), ("x.png", "shows one episode")):
        with pytest.raises(ConfigError, match=said):
            play_episodes(toy, tmp_path / name, episodes=2)
    assert [path.name for path in tmp_path.iterdir()] == ["x.mp4"]


def test_a_policy_that_holds_its_actions_is_asked_as_in_an_evaluation():
    asked = []

    class Holds(ConstantPolicy):
        hold = 2

        def act(self, observation):
            asked.append(observation[0, 1])
            return super().act(observation)

    playing = _Play(Holds(2, 1), Drawn(STEPS), lambda _: True, 0.5, Streams(0))
    playing.play(2, np.inf)
    assert asked == [0, 2, 0, 2]
