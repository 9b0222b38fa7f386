import json

import pytest

from tests.cli.commands import refusal, run, run_json
from transferkit import load_match

CORE, TWO = "inverted-pendulum-v1", "InvertedDoublePendulum-v5"


def test_a_match_is_shown_written_and_trained_with(capsys, tmp_path):
    path = tmp_path / "m.yaml"
    text = run(capsys, "match", CORE, TWO, "--yaml", str(path))[1]
    assert f"{CORE} on {TWO}: 4 of 4 inputs and 1 of 1 actions are matched" in text
    data = run_json(capsys, "match", CORE, TWO)
    assert (data["inputs"], data["actions"], data["holds"], data["hold"]) == (1.0, 1.0, True, 1)
    assert "# not matched: target joint hinge_y2: nothing like it is left" in path.read_text()
    assert [(one["kind"], one["name"]) for one in data["unmatched"]] == [("target joint", "hinge_y2")]
    (tmp_path / "m.json").write_text(json.dumps(data))  # what --json prints is handed back as it is
    assert load_match(tmp_path / "m.json") == load_match(path)
    assert f"{path} is a match; hand it to --match" in refusal(capsys, "match", path, TWO)
    path.write_text(path.read_text().replace("{hinge_y: 1.0}", "{hinge_y2: 1.0}"))
    scores = run_json(capsys, "eval", CORE, "--env", TWO, "--match", path, "--episodes", 2)
    assert scores["returns"] != run_json(capsys, "eval", CORE, "--env", TWO, "--episodes", 2)["returns"]
    own = refusal(capsys, "record", CORE, "--match", path, "--out", tmp_path / "x.mcap")
    assert f"{CORE} plays in its own environment as it is, without --match; give another --env" in own
    out = ("--env", TWO, "--core", CORE, "--match", str(path), "--steps", "40", "--eval-episodes", "1")
    run(capsys, "train", *out, "--out", str(tmp_path / "run"))
    found = run_json(capsys, "match", str(tmp_path / "run"), TWO)
    assert found["source"] == TWO
    path.unlink()  # a run has the match that it began with
    assert "return" in run(capsys, "eval", str(tmp_path / "run"), "--episodes", "1")[1]


def test_nothing_that_crosses_is_said(capsys):
    assert "nothing crosses" in run(capsys, "match", "InvertedPendulum-v5", "Hopper-v5")[1]
    assert "nothing crosses" in run(capsys, "zoo", "find", "dm_control/acrobot-swingup-v0")[1]


def test_cores_are_found_by_how_much_of_them_there_is(capsys):
    rows = run_json(capsys, "zoo", "find", "InvertedPendulum-v5", "--play")
    assert [row["inputs"] * row["actions"] for row in rows] == sorted((r["inputs"] * r["actions"] for r in rows), reverse=True)
    walker = [row["core"] for row in run_json(capsys, "zoo", "find", "Walker2d-v5")]
    own, *one_leg = walker[:3]
    assert (own, one_leg) == ("walker2d-v1", ["hopper-family-v1", "hopper-v1"])
    assert walker[3:5] == ["walker-stand-v1", "walker-walk-v1"]  # the suite's walker swings its hips the other way
    assert rows[0]["source"] == "InvertedPendulum-v5"  # of those that are all there, the environment's own come first
    pole = next(row for row in rows if row["core"] == CORE)
    assert (pole["source"], pole["inputs"], pole["returns"]) == ("InvertedPendulum-v5", 1.0, [1000.0] * 5)


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        (f"match inverted-pendulm-v1 {TWO}", "unknown core, run or environment 'inverted-pendulm-v1'; did you mean"),
        (f"match {CORE} Hoper-v5", "unknown environment 'Hoper-v5'; did you mean Hopper-v5"),
        (f"match {CORE} {TWO} --vary mass", f"variation of environment {TWO}='mass' must be NAME=VALUE"),
        (f"match {CORE} {TWO} --stagger far", "--stagger='far' must be a number of radians"),
        (f"match {CORE} {TWO} --stagger 9", "stagger=9.0 must be at least -3.2 and at most 3.2"),
        (f"match {CORE} {TWO} --limbs some", "unknown limbs 'some'; did you mean one"),
        (f"match {CORE} {TWO} --yaml m.txt", "ending of m.txt='.txt' must be .yaml"),
        (f"train --env {TWO} --steps 9 --match m.yaml", "--match m.yaml has no effect without a core; give --core"),
        (
            f"train --env {TWO} --steps 9 --core {CORE} --match no.yaml",
            "cannot read the match no.yaml: No such file or directory",
        ),
        ("zoo find Hoper-v5", "unknown environment 'Hoper-v5'; did you mean Hopper-v5"),
    ],
)
def test_mistakes_are_one_line(capsys, monkeypatch, tmp_path, arguments, message):
    monkeypatch.chdir(tmp_path)
    assert message in refusal(capsys, *arguments.split())
