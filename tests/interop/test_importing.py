"""Importing writes a core with its origin, and says when something was read wrongly."""

import json

import gymnasium
import numpy as np
import pytest
import torch

from tests.interop import writers
from transferkit import ArtifactError, evaluate, import_core, load_core, load_subject
from transferkit.cli.main import main
from transferkit.errors import SettingError
from transferkit.importing import run_import
from transferkit.interop import Given
from transferkit.zoo.card import read_card
from transferkit.zoo.verify import verify

ENV = "InvertedPendulum-v5"


@pytest.fixture(scope="session")
def released(tmp_path_factory):
    """The first member of a core of the zoo as CleanRL's PPO would write it, with its statistics beside it."""

    def write(name):
        folder, core = tmp_path_factory.mktemp(name), load_core(name)
        state, statistics = core.network(0).state_dict(), core.normalizer(0)
        half = core.spec.action[0].high
        saved = {name.replace("body", "actor_mean"): value for name, value in state.items() if name.startswith("body")}
        last = f"actor_mean.{2 * len(core.architecture.hidden)}"
        saved |= {f"{last}.{kind}": half * state[f"mean_head.{kind}"] for kind in ("weight", "bias")}
        torch.save({**saved, "actor_logstd": state["log_std"][None] + np.log(half)}, folder / "m.cleanrl_model")
        np.savez(folder / "stats.npz", mean=statistics.mean.numpy(), var=statistics.var.numpy())
        return folder / "m.cleanrl_model", folder / "stats.npz"

    return write


def test_a_core_is_written_with_score_origin_and_licence(released, tmp_path, capsys):
    file, stats = released("inverted-pendulum-v1")
    zoo = tmp_path / "zoo"
    command = [
        "import",
        str(file),
        "--env",
        ENV,
        "--stats",
        str(stats),
        "--name",
        "pole",
        "--zoo",
        str(zoo),
        "--licence",
        "MIT",
    ]
    assert main([*command, "--json"]) == 0
    answer = json.loads(capsys.readouterr().out)
    card = read_card(zoo / "pole-v1")
    assert answer["score_mean"] == card.score.mean == 1000.0
    assert (answer["warnings"], card.score.episodes, card.licence) == ([], 20, "MIT")
    assert card.origin.library == "CleanRL PPO"
    assert answer["digest"] == card.digest
    assert "normalizer" in card.components
    own = load_core("inverted-pendulum-v1").policy(0)
    observation = writers.observations(4)
    assert np.abs(own.act(observation) - load_core(zoo / "pole-v1").policy().act(observation)).max() <= 1e-5
    assert verify(zoo / "pole-v1", rollout=True)["rollout_mean"] == 1000.0
    assert main(command) == 2
    assert "never rewritten" in capsys.readouterr().err


def test_a_score_below_the_threshold_is_refused(released, tmp_path):
    file, _ = released("inverted-pendulum-v1")
    with pytest.raises(ArtifactError, match=r"return [\d.]+ is below the threshold 500"):
        import_core(file, env=ENV, stats="none", threshold=500, name="pole", zoo=tmp_path / "zoo")
    with pytest.raises(SettingError, match="threshold=nan must be"):
        import_core(file, env=ENV, stats="none", threshold=float("nan"), name="pole", zoo=tmp_path / "zoo")
    assert not (tmp_path / "zoo").exists()


def test_wrong_guesses_are_said(released):
    file, stats = released("pendulum-swingup-v1")  # which has relu and not the tanh of CleanRL's script
    env = load_core("pendulum-swingup-v1").spec.env_id
    wrong = run_import(file, env, Given(stats=stats), None).warnings
    assert any("with activation relu it returns" in warning for warning in wrong)
    file, _ = released("inverted-pendulum-v1")
    assert any("above zero action in" in warning for warning in run_import(file, ENV, Given(stats="none"), None).warnings)


def test_a_file_is_imported_on_the_fly(tmp_path, caplog):
    agent, path = writers.CleanRLActor(gymnasium.make(ENV), gaussian=False), tmp_path / "m.cleanrl_model"
    torch.save((agent.state_dict(),), path)
    subject = load_subject(str(path), env=ENV)
    assert f"{path} is taken as a policy of {ENV} (CleanRL TD3 or DDPG)" in caplog.text
    assert len(evaluate(subject.policy, ENV, episodes=2).returns) == 2
    budget = ["--steps", "64", "--eval-episodes", "1", "--out", str(tmp_path / "run")]
    assert main(["train", "--env", ENV, "--core", str(path), *budget]) == 0
    assert main(["eval", str(tmp_path / "run"), "--episodes", "1"]) == 0
