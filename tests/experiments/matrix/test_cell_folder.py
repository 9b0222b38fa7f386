import itertools
import json
import shutil
from dataclasses import replace

import numpy as np
import pytest

from experiments.matrix.cell import Cell
from experiments.matrix.cell_folder import CELLS, SET_ASIDE, pack, read_cell, unpack
from experiments.matrix.grid_toml import load_cells
from experiments.matrix.results import collect, read_results
from experiments.matrix.runner import damages, run_cell
from transferkit import run_training
from transferkit.config import TrainConfig, with_settings
from transferkit.errors import RunDirectoryError
from transferkit.files import read_json
from transferkit.run import EvaluationRow, Result, read_table


@pytest.mark.parametrize(
    ("name", "change", "what"),
    [
        ("run/policy.safetensors", lambda data: data[:-100], "policy.safetensors: "),
        ("run/policy.safetensors", lambda _: None, "policy.safetensors: "),
        ("run/run.json", lambda _: None, "run.json is missing"),
        ("run/run.json", lambda data: data.replace(b'"versions": {', b'"versions": [], "v": {'), "run.json: "),
        ("run/episodes.csv", lambda data: data.replace(b"return", b"reward"), "episodes.csv: "),
        ("run/episodes.csv", lambda data: data.replace(b"\n1,", b"\nnan,", 1), "episodes.csv: "),
        ("run/episodes.csv", lambda data: data[: data.rindex(b"\n", 0, -1) + 1], "episodes.csv: ValueError: it does not have"),
        ("run/result.json", lambda data: data.replace(b"steps", b"step"), "result.json: "),
        ("run/result.json", lambda data: data[:9], "result.json: "),
        ("run/result.json", lambda _: None, "result.json: "),
        ("cell.json", lambda data: data.replace(b'"arm"', b'"arms"'), "cell.json: "),
        ("cell.json", lambda _: None, "cell.json: "),
        ("cell.json", lambda data: data.replace(b'"seed": 0', b'"seed": 1', 1), "cell.json describes another run"),
        ("run/evaluations.csv", lambda data: data.replace(b",n,core\n", b",m,core\n"), "evaluations.csv: "),
        ("run/result.json", lambda data: data.replace(b'"eval_episodes": 2', b'"eval_episodes": 3'), "evaluations.csv: "),
        ("speed.json", lambda data: data[:5], "speed.json: "),
    ],
)
def test_damage_is_named_by_its_file(results, tmp_path, name, change, what):
    cell = next(cell for cell in load_cells(results / "grid.toml") if cell.arm == "scratch")
    where = tmp_path / CELLS / cell.id
    shutil.copytree(results / CELLS / cell.id, where)
    without_checksums(where)
    assert read_results(tmp_path).damaged == {}
    data = change((where / name).read_bytes())
    (where / name).unlink()
    if data is not None:
        (where / name).write_bytes(data)
    assert read_results(tmp_path).damaged[where].startswith(what)


@pytest.mark.parametrize("core", ["inverted-pendulum-v2", "cartpole-swingup-v2"])
def test_a_run_with_probation_is_measured_from_its_first_step(tmp_path, core, caplog):
    config = TrainConfig("InvertedDoublePendulum-v5", core=core, episodes=60, eval_episodes=2, eval_every=100)
    config = with_settings(config, {"ppo.rollout": "steps", "ppo.rollout_steps": 32, "ppo.num_envs": 1, "network.hidden": [8]})
    cell = Cell("transfer", core, "small", config)
    assert run_cell(cell, tmp_path, "the command").error == ""
    assert not caplog.messages
    (row,) = read_results(tmp_path).finished
    probation = read_json(tmp_path / CELLS / cell.id / "run" / "result.json", Result).probation
    assert row.refused == int(not probation.accepted)
    table = read_table(tmp_path / CELLS / cell.id / "run", EvaluationRow)
    assert row.first_return_mean == pytest.approx(table["return_mean"][0], abs=1e-3)
    assert row.core_share == pytest.approx(table["core"].mean(), abs=1e-3)
    heights = (table["return_mean"][1:] + table["return_mean"][:-1]) / 2
    whole = probation.steps * np.mean(probation.zero) + (heights * np.diff(table["steps"])).sum()
    assert row.area == pytest.approx(whole / table["steps"][-1], abs=1e-3)


def without_checksums(where):
    """As earlier versions wrote it, so that what a file says is judged, and not that it was changed."""
    for path in where.rglob("*.json"):
        data = json.loads(path.read_text())
        path.write_text(json.dumps({name: value for name, value in data.items() if name not in ("digest", "files")}, indent=2))


@pytest.mark.parametrize("name", ["run/run.json", "run/result.json", "run/episodes.csv", "run/policy.safetensors", "cell.json"])
def test_one_digit_is_noticed(results, tmp_path, name):
    cell = next(cell for cell in load_cells(results / "grid.toml") if cell.arm == "scratch")
    where = tmp_path / CELLS / cell.id
    shutil.copytree(results / CELLS / cell.id, where)
    data = (where / name).read_bytes()
    at = max(data.rindex(digit) for digit in (b"1", b"2", b"3") if digit in data)
    (where / name).write_bytes(data[:at] + b"9" + data[at + 1 :])
    assert "it was changed" in read_results(tmp_path).damaged[where]


def test_damaged_runs_enter_no_table_and_run_again(copy):
    with_episodes = (path for path in sorted((copy / CELLS).glob("*/run/episodes.csv")) if path.read_text().count("\n") > 3)
    short, forged, cut, *more = itertools.islice(with_episodes, 5)
    short.write_text(short.read_text()[:40])
    (forged.parent / "result.json").write_text((forged.parent / "result.json").read_text().replace("seconds", "second"))
    cell = cut.parents[1] / "cell.json"
    cell.write_text(cell.read_text().replace('"seed": ', '"seed": 7'))
    (more[0].parents[1] / "cell.json").unlink()
    (more[1].parent / "evaluations.csv").write_text("".join((more[1].parent / "evaluations.csv").open().readlines()[:-1]))
    found = read_results(copy)
    assert len(found.finished) == 11 - 5
    assert len(found.damaged) == 5
    assert all("without --dry-run" in line for line in damages(copy, found, move=False))
    assert len(damages(copy, found, move=True)) == len(list((copy / SET_ASIDE).iterdir())) == 5
    done = {row.id for row in found.finished}
    todo = [cell for cell in load_cells(copy / "grid.toml") if cell.id not in done]
    assert [run_cell(cell, copy, "the command").error for cell in todo] == [""] * 5
    assert len(collect(copy)) == 11


def test_a_run_without_its_last_file_is_not_done_and_goes_on(copy):
    cell = load_cells(copy / "grid.toml")[0]
    where = copy / CELLS / cell.id
    (where / "speed.json").unlink()
    assert read_cell(where) is None
    before = (where / "run" / "result.json").read_bytes()
    assert run_cell(cell, copy, "the command").error == ""
    assert (where / "run" / "result.json").read_bytes() == before
    assert read_cell(where).finished


def test_a_cell_of_an_earlier_version_is_refused(copy):
    where = next((copy / CELLS).iterdir())
    data = json.loads((where / "cell.json").read_text())
    del data["config"]["network"]
    (where / "cell.json").write_text(json.dumps(data))
    without_checksums(where)
    with pytest.raises(RunDirectoryError, match="was made by an earlier version"):
        read_results(copy)


def test_a_cell_travels_as_its_files(results, tmp_path):
    where = next(path for path in (results / CELLS).iterdir() if (path / "run" / "episodes.csv").exists())
    files = pack(where)
    assert [*files][-1] == "speed.json"  # what makes it finished comes last
    unpack(tmp_path / where.name, files)
    assert repr(read_cell(tmp_path / where.name)) == repr(read_cell(where))


def test_a_run_that_was_given_more_budget_is_read_with_all_that_it_spent(results, tmp_path):
    cell = next(cell for cell in load_cells(results / "grid.toml") if cell.arm == "scratch")
    where = shutil.copytree(results / CELLS / cell.id, tmp_path / CELLS / cell.id)
    before = read_cell(where)
    longer = replace(cell.config, episodes=None, seconds=None, steps=before.steps + 100)
    result = run_training(longer, out=where / "run", resume=True)
    row = read_cell(where)
    assert (row.steps, row.episodes, row.eval_return_mean) == (before.steps + 100, result.episodes, result.eval_return_mean)
    assert (row.budget_steps, row.budget_episodes) == (before.budget_steps, before.budget_episodes)
