"""Pictures are drawn as SVG, whose comments hold what is written in them."""

import re
from dataclasses import asdict

import matplotlib.pyplot as plt
import pytest

from tests.record.foreign import MAPPING, write_foreign
from transferkit import load_subject, record_episodes
from transferkit.config import TrainConfig
from transferkit.errors import ConfigError, RecordingError, RunDirectoryError
from transferkit.plots import draw_learning_curves, draw_recording, draw_run
from transferkit.run import EpisodeRow, EvaluationRow, ModelRow, RunDirectory

RETURNS = (1.0, 5.0, 3.0)


@pytest.fixture
def run(tmp_path):
    """Makes the directory of a run of three episodes."""

    def make(*rows, name="run", returns=RETURNS):
        config = asdict(TrainConfig("Hopper-v5", algo="dyna-ddpg", seed=7))
        with RunDirectory.create(tmp_path / name, config) as directory:
            for k, total in enumerate(returns, 1):
                directory.append(EpisodeRow(k, 0, total, 10, 1, 10 * k, 0.1))
            for row in rows:
                directory.append(row)
        return tmp_path / name

    return make


def said(picture):
    return set(re.findall(r"<!-- (.*) -->", picture.read_text()))


def test_a_run_is_drawn_with_its_evaluations(run, tmp_path):
    draw_run(run(EvaluationRow(3, 30, 0.1, 4.0, 1.0, 3.0, 5.0, 2)), tmp_path / "x.svg")
    assert {
        "Hopper-v5, dyna-ddpg, scratch, seed 7",
        "training",
        "evaluation, 95 % interval",
        "training episodes",
        "environment steps",
    } <= said(tmp_path / "x.svg")
    assert "observation error / deviation" not in said(tmp_path / "x.svg")


def test_a_runs_model_is_drawn_below(run, tmp_path):
    draw_run(run(ModelRow(250, 0.1, 0.2, float("nan"), 0.3, 0.4, 0.9, 0.5)), tmp_path / "x.svg")
    assert {"observation error / deviation", "20 steps", "members' disagreement", "ends foreseen"} <= said(tmp_path / "x.svg")


def test_runs_are_drawn_together_over_what_doing_nothing_gives(run, tmp_path):
    runs = {"core": run(), "scratch": run(name="other", returns=(2.0,) * 30)}
    draw_learning_curves(runs, "two runs", tmp_path / "x.svg", zero_action=2.0)
    assert {"two runs", "core", "scratch", "dotted: zero action", "return (line: mean of 20 episodes)"} <= said(
        tmp_path / "x.svg"
    )
    draw_learning_curves(runs, "two runs", tmp_path / "x.png")
    assert plt.imread(tmp_path / "x.png").std() > 0.01
    assert not plt.get_fignums()  # nothing stays open


def test_an_episode_of_a_recording_is_drawn(tmp_path):
    file = tmp_path / "x.mcap"
    record_episodes(load_subject("inverted-pendulum-v1", env="Hopper-v5"), file)
    draw_recording(file, tmp_path / "x.svg")
    assert {"observation", "core input", "core output, first 12 of 64", "action", "reward", "simulated seconds"} <= said(
        tmp_path / "x.svg"
    )
    with pytest.raises(RecordingError, match=r"x.mcap has no step of episode 3; use episode=0"):
        draw_recording(file, tmp_path / "y.svg", episode=3)


def test_another_tools_recording_is_drawn_by_a_mapping(tmp_path):
    file = write_foreign(tmp_path / "x.mcap")
    (tmp_path / "m.toml").write_text(MAPPING)
    draw_recording(file, tmp_path / "x.svg", mapping=tmp_path / "m.toml")
    names = {"position.0", "velocity.1", "x", "reward", "seconds in the log", "x.mcap, episode 0: return 25.0"}
    assert names <= said(tmp_path / "x.svg")
    draw_recording(file, tmp_path / "y.svg", mapping=tmp_path / "m.toml", episode=1)
    assert "x.mcap, episode 1: return 11.0" in said(tmp_path / "y.svg")
    with pytest.raises(RecordingError, match="no step of episode 2"):
        draw_recording(file, tmp_path / "z.svg", mapping=tmp_path / "m.toml", episode=2)
    with pytest.raises(RecordingError, match="name its channels with mapping"):
        draw_recording(file, tmp_path / "z.svg")


def test_names_from_outside_are_shown_as_they_are(run, tmp_path):
    draw_learning_curves({r"_$\frac{$": run()}, "$x$", tmp_path / "x.svg")
    assert {r" _$\frac{$", "$x$"} <= said(tmp_path / "x.svg")


def test_what_cannot_be_drawn_is_refused(run, tmp_path):
    with pytest.raises(RunDirectoryError, match="no finished episode yet; train longer, then plot"):
        draw_run(run(returns=()), tmp_path / "x.png")
    with pytest.raises(RunDirectoryError, match=r"holds no run.json"):
        draw_run(tmp_path, tmp_path / "x.png")
    with pytest.raises(ConfigError, match=r"ending of .*x.doc='.doc' must be .*\.png.*\.svg"):
        draw_run(run(name="other"), tmp_path / "x.doc")
    with pytest.raises(ConfigError, match=r"cannot write .*: No such file .*; choose another out"):
        draw_run(tmp_path / "other", tmp_path / "nowhere/x.png")
    assert not plt.get_fignums()
