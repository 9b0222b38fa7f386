"""Properties of every reader: a damaged file is refused in a line or read as it was; a forged one is refused or usable."""

import json
import os
import shutil

import pytest
import torch
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st

from experiments.matrix.grid_toml import load_cells
from tests.record.foreign import MAPPING
from transferkit import derive_spec, load_core, read_transitions, record_episodes, replay_recording, run_training
from transferkit.config import TrainConfig, with_settings
from transferkit.errors import ArtifactError, EnvironmentContractError, RunDirectoryError, TransferkitError
from transferkit.files import read_json, write_json
from transferkit.policy.saved import load_policy
from transferkit.reading import FormatError, parse, sealed
from transferkit.record.mapping import load_mapping
from transferkit.record.reader import read
from transferkit.record.recover import recover
from transferkit.run import EpisodeRow, Result, load_state, read_record, read_table, save_state
from transferkit.subject import evaluate_subject, load_subject
from transferkit.zoo.card import read_card
from transferkit.zoo.catalog import list_cards
from transferkit.zoo.verify import verify

ENV = "InvertedPendulum-v5"
GRID = f'targets = ["{ENV}"]\narms = ["scratch"]\nseeds = "0-2"\nsteps = 100\n[[trainer]]\nset = {{"ppo.gamma" = 0.9}}\n'

VALUES = st.recursive(
    st.none()
    | st.booleans()
    | st.integers()
    | st.floats()
    | st.text(max_size=5)
    | st.sampled_from([10**400, "a:b", "\x1b[1m"]),
    lambda inner: st.lists(inner, max_size=3) | st.dictionaries(st.text(max_size=5), inner, max_size=3),
    max_leaves=5,
)
"""JSON of any kind, and what only looks like it."""

QUICKLY = settings(
    max_examples=60, deadline=None, suppress_health_check=[HealthCheck.function_scoped_fixture, HealthCheck.too_slow]
)


@pytest.fixture(scope="session")
def run(tmp_path_factory):
    out = tmp_path_factory.mktemp("run") / "run"
    config = TrainConfig(ENV, steps=64, eval_episodes=1, checkpoint_seconds=0.0)
    run_training(with_settings(config, {"network.hidden": [4], "ppo.rollout": "steps", "ppo.rollout_steps": 32}), out=out)
    return out


@pytest.fixture(scope="session")
def recorded(tmp_path_factory):
    path = tmp_path_factory.mktemp("recorded") / "a.mcap"
    record_episodes(load_subject("inverted-pendulum-v1", env="Reacher-v5"), path)
    return path


@pytest.fixture
def core(full_core_folder):
    return full_core_folder


def table(folder):
    return {name: column.tolist() for name, column in read_table(folder, EpisodeRow).items()}


def tensors(folder):
    return {name: tensor.tolist() for name, tensor in load_policy(folder).state_dict().items()}


READERS = {
    "card.json": ("core", read_card),
    "core.safetensors": ("core", lambda folder: load_core(folder).digest),
    "probe.safetensors": ("core", verify),
    "run.json": ("run", lambda folder: TrainConfig.from_json(read_record(folder))),
    "result.json": ("run", lambda folder: read_json(folder / "result.json", Result)),
    "episodes.csv": ("run", table),
    "policy.safetensors": ("run", tensors),
    "checkpoint.safetensors": ("run", lambda folder: str(load_state(folder / "checkpoint.safetensors"))),
}


@pytest.mark.parametrize("name", READERS)
@QUICKLY
@given(data=st.data())
def test_a_damaged_file_is_refused_or_read_as_it_was(name, data, request, tmp_path):
    sample, reader = READERS[name]
    folder = fresh(request.getfixturevalue(sample), tmp_path)
    whole, content = reader(folder), (folder / name).read_bytes()
    (folder / name).write_bytes(data.draw(damaged(content)))
    found = outcome(lambda: reader(folder))
    assert isinstance(found, TransferkitError) or found == whole


@pytest.mark.parametrize("name", ["card.json", "run.json", "result.json"])
@QUICKLY
@given(data=st.data())
def test_a_forged_value_is_refused_or_usable(name, data, request, tmp_path):
    sample, reader = READERS[name]
    folder = fresh(request.getfixturevalue(sample), tmp_path)
    content = json.loads((folder / name).read_text())
    place, key = data.draw(st.sampled_from(places(content)))
    place[key] = data.draw(VALUES)
    (folder / name).write_text(json.dumps(seal(content)))
    outcome(lambda: reader(folder))


@pytest.mark.parametrize("text", [MAPPING, GRID], ids=["mapping", "grid"])
@QUICKLY
@given(data=st.data())
def test_a_damaged_toml_is_refused_or_one(text, data, tmp_path):
    path = tmp_path / "file.toml"
    path.write_bytes(data.draw(damaged(text.encode())))
    outcome(lambda: (load_mapping if text == MAPPING else load_cells)(path))


@QUICKLY
@given(data=st.data())
def test_a_damaged_recording_is_read_in_part_and_says_so(data, recorded, tmp_path):
    spec, path = derive_spec("Reacher-v5"), tmp_path / "a.mcap"
    whole = rows(read_transitions(recorded, spec))
    path.write_bytes(data.draw(damaged(recorded.read_bytes())))
    found = outcome(lambda: read_transitions(path, spec))
    if not isinstance(found, TransferkitError):
        assert set(rows(found)) <= set(whole)
        assert found.notes or rows(found) == whole


def test_one_flipped_bit_in_a_chunk_costs_that_chunk_alone(recorded, tmp_path):
    path = tmp_path / "a.mcap"
    record_episodes(load_subject("inverted-pendulum-v1", env="Hopper-v5"), path, episodes=9)
    content, whole = path.read_bytes(), read(path).steps
    at = len(content) // 2
    path.write_bytes(content[:at] + bytes([content[at] ^ 1]) + content[at + 1 :])
    contents = read(path)
    assert contents.flaw == "is damaged"
    assert 0 < len(contents.steps) < len(whole)
    assert contents.steps[0] == whole[0]
    assert contents.steps[-1] == whole[-1]
    assert "is damaged" in read_transitions(path, derive_spec("Hopper-v5")).notes[0]
    assert replay_recording(path).difference == ""


@pytest.mark.parametrize("bad", [float("nan"), float("inf")])
def test_numbers_that_are_not_finite_are_refused_with_right_checksums(bad, run, tmp_path):
    folder = fresh(run, tmp_path)
    state = load_state(folder / "policy.safetensors")
    next(iter(state["weights"].values())).view(-1)[0] = bad
    save_state(folder / "policy.safetensors", state)
    with pytest.raises(RunDirectoryError, match="has NaN or infinite numbers"):
        load_policy(folder)
    with pytest.raises(FormatError):
        parse(f'{{"a": {json.dumps(bad)}}}', dict)


@pytest.mark.parametrize(
    ("files", "message"),
    [
        ({}, "files of its card"),
        ({"../../x": "0" * 64}, "files of its card"),
        ({"core.safetensors": "0" * 64}, "files of its card"),
    ],
)
def test_a_card_names_its_own_files_all_of_them_and_no_other(files, message, core):
    card = json.loads((core / "card.json").read_text())
    (core / "card.json").write_text(json.dumps(sealed({**card, "files": files})))
    with pytest.raises(ArtifactError, match=message):
        load_core(core)


def test_only_a_regular_file_of_a_core_is_read(core, tmp_path):
    weights = core / "core.safetensors"
    shutil.move(weights, tmp_path / "elsewhere")
    weights.symlink_to(tmp_path / "elsewhere")
    with pytest.raises(ArtifactError, match=r"core\.safetensors cannot be read"):
        load_core(core)
    for make in (lambda: weights.symlink_to("/dev/zero"), lambda: os.mkfifo(weights), weights.mkdir):
        weights.rmdir() if weights.is_dir() and not weights.is_symlink() else weights.unlink()
        make()
        with pytest.raises(ArtifactError, match=r"core\.safetensors"):
            load_core(core)
    weights.rmdir()
    with weights.open("wb") as file:
        file.truncate(20 * 2**30)  # sparse
    with pytest.raises(ArtifactError, match="has 21,474,836,480 bytes, at most"):
        load_core(core)


def test_a_declared_size_that_the_file_does_not_justify_is_refused_before_anything_is_allocated(core):
    card = json.loads((core / "card.json").read_text())
    card["parts"]["policy"]["architecture"]["hidden"] = [20_000] * 3
    (core / "card.json").write_text(json.dumps(sealed(card)))
    with pytest.raises(ArtifactError, match="fewer numbers than its architecture"):
        load_core(core)


def test_one_bad_card_does_not_hide_the_others(core, monkeypatch):
    monkeypatch.setenv("TRANSFERKIT_ZOO", str(core.parent))
    (core / "card.json").write_text("[" * 100_000)
    cards, errors = list_cards()
    assert len(cards) >= 7
    assert len(errors) == 1


@pytest.mark.parametrize("env_id", ["planted:Env-v0", "a:b:c", ":X", "..:X"])
def test_an_environment_id_from_a_file_imports_nothing(env_id, run, recorded, tmp_path, monkeypatch):
    (tmp_path / "planted.py").write_text(f"open({str(tmp_path / 'ran')!r}, 'w')")
    monkeypatch.syspath_prepend(tmp_path)
    folder = fresh(run, tmp_path)
    record = json.loads((folder / "run.json").read_text())
    record["config"]["env"] = env_id
    write_json(folder / "run.json", record)
    for use in (lambda: evaluate_subject(load_subject(str(folder))), lambda: load_subject(str(folder))):
        with pytest.raises(EnvironmentContractError, match=r"runs the module .*; if you trust that, name it yourself: env="):
            use()
    assert not (tmp_path / "ran").exists()


def fresh(folder, tmp_path):
    """A copy of a sample."""
    target = tmp_path / "sample" / folder.name
    shutil.rmtree(target, ignore_errors=True)
    return shutil.copytree(folder, target)


def outcome(use):
    """What a reader returns, or the error, which is one line that a terminal may show."""
    try:
        return use()
    except TransferkitError as raised:
        error = raised
    assert str(error).isprintable()
    return error


@st.composite
def damaged(draw, content):
    """Bytes of which some are flipped, cut out or put in."""
    at = draw(st.integers(0, len(content) - 1))
    kind = draw(st.sampled_from(["flip", "cut", "insert", "end"]))
    if kind == "flip":
        return content[:at] + bytes([content[at] ^ draw(st.integers(1, 255))]) + content[at + 1 :]
    if kind == "end":
        return content[:at]
    width = draw(st.integers(1, 20))
    return content[:at] + (b"" if kind == "cut" else draw(st.binary(min_size=1, max_size=20))) + content[at + width :]


def places(node):
    """Every container in a JSON value with each of its keys."""
    keys = list(node) if isinstance(node, dict) else range(len(node)) if isinstance(node, list) else []
    return [(node, key) for key in keys] + [place for key in keys for place in places(node[key])]


def seal(content):
    try:
        return sealed(content)
    except ValueError:  # NaN has no checksum
        return content


def rows(transitions):
    columns = [torch.as_tensor(column).reshape(len(transitions), -1) for column in transitions.batch()]
    return [tuple(row.tolist()) for row in torch.cat(columns, 1)]


@pytest.mark.parametrize("name", [".lock", "episodes.csv", "policy.safetensors"])
@pytest.mark.parametrize("kind", ["link", "pipe"])
def test_a_run_writes_through_no_link_and_waits_for_no_pipe(name, kind, run, tmp_path):
    folder, victim = fresh(run, tmp_path), tmp_path / "victim"
    victim.write_text("mine")
    (folder / "result.json").unlink()
    (folder / name).unlink(missing_ok=True)
    (folder / name).symlink_to(victim) if kind == "link" else os.mkfifo(folder / name)
    config = TrainConfig.from_json(read_record(folder))
    with pytest.raises(RunDirectoryError, match="is not a regular file"):
        run_training(config, out=folder, resume=True)
    assert victim.read_text() == "mine"


def test_what_is_written_replaces_a_link_in_its_way(tmp_path):
    victim = tmp_path / "victim"
    victim.write_text("mine")
    (tmp_path / "a.json.tmp").symlink_to(victim)
    write_json(tmp_path / "a.json", {"a": 1})
    assert victim.read_text() == "mine"


def test_a_recovered_recording_says_that_steps_are_missing(tmp_path):
    out = tmp_path / "recovered.mcap"
    record_episodes(load_subject("inverted-pendulum-v1", env="Hopper-v5"), tmp_path / "a.mcap", episodes=9)
    content = (tmp_path / "a.mcap").read_bytes()
    at = len(content) // 2
    (tmp_path / "b.mcap").write_bytes(content[:at] + bytes([content[at] ^ 1]) + content[at + 1 :])
    assert recover(tmp_path / "b.mcap", out)[1]
    assert replay_recording(out).flaw == "lacks steps of its episodes"
    assert read_transitions(out, derive_spec("Hopper-v5")).notes
