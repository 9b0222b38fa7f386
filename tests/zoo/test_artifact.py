import hashlib
import json
import shutil

import numpy as np
import pytest
import safetensors.torch
import torch

from transferkit import load_core
from transferkit.cli.main import main
from transferkit.envs import make_env
from transferkit.errors import ArtifactError, ConfigError, UnknownNameError
from transferkit.reading import digest
from transferkit.zoo.artifact import save_core
from transferkit.zoo.card import read_card
from transferkit.zoo.catalog import core_folders
from transferkit.zoo.readme import render
from transferkit.zoo.verify import verify

CORES = core_folders()

FIRST = {
    *("inverted-pendulum-v1", "cartpole-balance-v1", "cartpole-swingup-v1"),
    *("inverted-pendulum-v2", "cartpole-balance-v2", "cartpole-swingup-v2", "pendulum-swingup-v1"),
}


@pytest.mark.parametrize("core_id", CORES)
def test_every_released_core_holds_what_its_card_says(core_id):
    card = read_card(CORES[core_id])
    assert verify(core_id)["probe"] < 1e-5
    assert card.id == core_id
    assert len(card.seeds) == len(card.score.members) == (5 if core_id in FIRST else 3)
    assert min(card.score.members) >= card.score.threshold
    assert (CORES[core_id] / "README.md").read_text() == render(card)
    assert sum(file.stat().st_size for file in CORES[core_id].iterdir()) < 1_000_000


def test_the_first_zoo_is_there():
    assert set(CORES) >= FIRST


@pytest.mark.parametrize("core_id", [name for name in CORES if "dynamics" in read_card(CORES[name]).components])
def test_a_released_model_predicts_its_own_task(core_id):
    core = load_core(core_id)
    policy, env, rng = core.policy(), make_env(core.spec.env_id), np.random.default_rng(0)
    observation, _ = env.reset(seed=0)
    steps = []
    for _ in range(100):
        action = (policy.act(observation[None])[0] + rng.normal(0, 0.2, core.spec.act_dim)).clip(-1, 1).astype(np.float32)
        following = env.step(action)[0]
        steps.append((observation, action, following))
        observation = following
    before, actions, after = map(torch.from_numpy, map(np.stack, zip(*steps, strict=True)))
    predicted = core.dynamics().predict(before, actions).next_observation.mean(0)
    assert (predicted - after).square().mean() < 0.1 * (after - before).square().mean()


def test_a_damaged_table_of_crossings_is_one_line(copy, capsys):
    (copy.parent / "crossings.json").write_text('{"study": "zero_shot"')
    assert main(["zoo", "show", str(copy)]) == 2
    said = capsys.readouterr().err
    assert (said.count("\n"), "crossings.json is damaged (not JSON" in said) == (1, True)
    (copy.parent / "crossings.json").unlink()
    assert main(["zoo", "show", str(copy)]) == 0
    assert "Untrained on other" not in capsys.readouterr().out


@pytest.fixture
def copy(tmp_path):
    return shutil.copytree(CORES["inverted-pendulum-v1"], tmp_path / "inverted-pendulum-v1")


def edit(folder, change, *, resign=True):
    data = json.loads((folder / "card.json").read_text())
    change(data)
    if resign:
        data.pop("digest", None)
        data["digest"] = digest(data)
    (folder / "card.json").write_text(json.dumps(data))


def test_a_folder_loads_like_an_id(copy):
    assert torch.equal(
        load_core(copy).components["policy"]["log_std"], load_core("inverted-pendulum-v1").components["policy"]["log_std"]
    )


@pytest.mark.parametrize("name", ["core.safetensors", "probe.safetensors"])
def test_truncated_or_changed_files_are_refused(copy, name):
    data = (copy / name).read_bytes()
    for bad in (data[:-3], data[:-1] + bytes([data[-1] ^ 1])):
        (copy / name).write_bytes(bad)
        with pytest.raises(ArtifactError, match=f"{name} is truncated or was changed"):
            load_core(copy)
    (copy / name).unlink()
    with pytest.raises(ArtifactError, match="lacks its file"):
        load_core(copy)


def test_a_changed_card_is_refused(copy):
    edit(copy, lambda data: data["score"].update(mean=1e6), resign=False)
    with pytest.raises(ArtifactError, match="digest does not fit"):
        load_core(copy)


def test_a_newer_schema_asks_for_an_upgrade(copy):
    edit(copy, lambda data: data.update(schema=2, novelty=1))
    with pytest.raises(ArtifactError, match=r"schema 2.*reads up to 1; upgrade"):
        load_core(copy)


@pytest.mark.parametrize("text", ["", "{", "[]", '{"schema": 1}', '{"schema": "x"}'])
def test_a_card_that_is_none(copy, text):
    (copy / "card.json").write_text(text)
    with pytest.raises(ArtifactError):
        load_core(copy)


def test_weights_that_do_not_fit_the_card(copy):
    edit(copy, lambda data: data["parts"]["policy"]["architecture"].update(hidden=[8, 8]))
    with pytest.raises(ArtifactError, match="do not fit its card"):
        load_core(copy)


def test_other_outputs_than_released_are_noticed(copy):
    stored = safetensors.torch.load_file(copy / "probe.safetensors")
    safetensors.torch.save_file({**stored, "mean": stored["mean"] + 1e-3}, copy / "probe.safetensors")
    edit(
        copy,
        lambda data: data["files"].update(
            {"probe.safetensors": hashlib.sha256((copy / "probe.safetensors").read_bytes()).hexdigest()}
        ),
    )
    with pytest.raises(ArtifactError, match="other outputs"):
        verify(copy)


def test_a_released_version_is_never_rewritten(copy):
    with pytest.raises(ArtifactError, match="never rewritten"):
        save_core(load_core(copy), read_card(copy), copy)


def test_unknown_cores_and_members():
    with pytest.raises(UnknownNameError, match="did you mean inverted-pendulum-v2 or inverted-pendulum-v1"):
        load_core("inverted-pendulum")
    with pytest.raises(ConfigError, match="member=5 must be 0 to 4 for core inverted-pendulum-v1"):
        load_core("inverted-pendulum-v1").network(5)


def test_critics_and_models_make_the_round_trip(full_core, full_core_folder):
    core = load_core(full_core_folder)
    assert core.ensembles == full_core.ensembles
    assert verify(full_core_folder)["probe"] == 0
    observation, action = torch.ones(3, 4), torch.zeros(3, 1)
    assert torch.equal(core.critic(1)(observation, action), full_core.critic(1)(observation, action))
    assert core.dynamics(0).predict(observation, action).next_observation.shape == (3, 3, 4)
    with pytest.raises(ConfigError, match="has no critic"):
        load_core("inverted-pendulum-v1").critic()


def test_the_card_in_the_file_says_parts(full_core_folder):
    """The name of a field of a released file does not change with the code's."""
    data = json.loads((full_core_folder / "card.json").read_text())
    assert set(data["parts"]) == {"policy", "normalizer", "critic", "dynamics"}
    assert "components" not in data
    assert json.loads(json.dumps(read_card(full_core_folder).to_json())) == data
