"""Matches as files: written, edited by hand, handed back; and what strangers may write."""

from dataclasses import replace

import pytest

from transferkit import load_match, match, save_match, wrap
from transferkit.errors import ConfigError, TransferkitError
from transferkit.pairing import Copy, Pairing

ONE, TWO = "InvertedPendulum-v5", "InvertedDoublePendulum-v5"
FILE = f"""\
source: {ONE}
target: {TWO}
copies:
- joints: {{hinge_y: {{hinge_y2: -1.0}}}}
  actions: {{drive.slide_x: {{drive.slide_x: 2}}}}
"""


def test_a_file_says_what_was_found(tmp_path):
    pairing = match(ONE, TWO)
    save_match(pairing, tmp_path / "m.yaml")
    assert load_match(tmp_path / "m.yaml") == pairing


def test_an_edited_file_is_what_the_policy_begins_with(tmp_path, untrained_core):
    (tmp_path / "m.yaml").write_text(FILE)
    text = wrap(untrained_core, TWO, match=tmp_path / "m.yaml").describe()
    assert "core input hinge_y.position = -1 atan2(hinge_y2.sin, hinge_y2.cos)" in text
    assert "core input slide_x.position = not matched: nothing is matched with slide_x" in text
    assert "action drive.slide_x = +2 drive.slide_x" in text


def test_a_file_may_use_the_names_that_the_models_have(tmp_path, untrained_core):
    names = {"hinge_y: ": "hinge: ", "hinge_y2": "hinge2", "drive.slide_x: {drive.slide_x": "slide: {slide"}
    text = FILE
    for canonical, model in names.items():
        assert canonical in text
        text = text.replace(canonical, model)
    (tmp_path / "canonical.yaml").write_text(FILE)
    (tmp_path / "model.yaml").write_text(text)
    one, other = (wrap(untrained_core, TWO, match=tmp_path / f"{name}.yaml").describe() for name in ("canonical", "model"))
    assert one == other
    (tmp_path / "model.yaml").write_text(FILE.replace("hinge_y: ", "hinge: {hinge_y: 1.0}, hinge_y: "))
    with pytest.raises(ConfigError, match="the match has hinge and hinge_y, which are one; leave one out"):
        wrap(untrained_core, TWO, match=tmp_path / "model.yaml")


def test_inputs_may_be_read_from_elements_whatever_the_joints_say(untrained_core):
    copy = Copy({}, {"drive.slide_x": {"drive.slide_x": 1.0}}, inputs={"hinge_y.position": {"slide_x.position": 3.0}})
    text = wrap(untrained_core, TWO, match=Pairing(ONE, TWO, (copy,))).describe()
    assert "core input hinge_y.position = +3 slide_x.position" in text
    assert "  joint hinge_y (hinge) = not matched: it is read by name alone" in text
    assert "  the target's joint slide_x (slider) = not matched: it is read by name alone" in text
    assert "  the target's joint hinge_y (hinge) = not matched: it is left out, though another could stand for it" in text


@pytest.mark.parametrize(
    ("old", "new", "message"),
    [
        ("hinge_y2", "hinge_y9", "unknown joint of the target in the match 'hinge_y9'; did you mean hinge_y or hinge_y2"),
        ("hinge_y:", "hinge_yy:", "unknown joint of the source in the match 'hinge_yy'; did you mean hinge_y"),
        ("{drive.slide_x: 2}", "{push: 2}", "unknown actuator of the source in the match 'push'; known are drive.slide_x"),
        (f"target: {TWO}", "target: Hopper-v5", f"the match has target Hopper-v5, and is used with {TWO}"),
        ("copies:", "copis:", "the match .* is none: unknown copis; known are source, target, copies, length, hold, forces"),
        ("joints:", "joint:", "the match .* is none: unknown joint; known are joints, actions, shift, inputs"),
        ("-1.0", "left", "the match .* is none: Expected `float`, got `str`"),
        ("-1.0", ".inf", "the match .* is none: its numbers must be finite"),
        ("-1.0", "-2.0e+9", r"the match .* is none: it has the number 2e\+09, and its numbers must be 1e\+09 at most"),
        ("copies:", "length: 1.0e-300\ncopies:", "its length is 1e-300, and must be between 1e-09 and"),
        ("copies:", "hold: 2\nhold: 3\ncopies:", "hold stands twice in one place, again in line"),
        ("joints:", "shift: {slide_x: 1.0}\n  joints:", "unknown shifted joint among those that the match reads"),
        ("copies:", "hold: 0\ncopies:", "its hold is 0 control steps, and must be between 1 and 10,000"),
        ("copies:", "length: -1\ncopies:", "its length is -1.0, and must be greater than 0"),
        ("copies:", "hold: &a [1]\nlength: &b [*a]\ncopies:", "its references stand for more than is read"),
        ("copies:", "copies: [", "the match .* is none: not YAML"),
        ("actions:", "inputs: {hinge_y.position: {}}\n  actions:", "core input hinge_y.position reads nothing in the match"),
        ("-1.0", "0.0", "joint hinge_y reads nothing in the match; leave it out"),
        (
            "copies:",
            "copies:\n- actions: {drive.slide_x: {drive.slide_x: 3}}",
            "copy 1 of the match reads nothing; leave",
        ),
        ("copies:", "copies:\n- joints: {hinge_y: {hinge_y: 1.0}}", "copy 1 of the match drives nothing; leave it out"),
    ],
)
def test_a_slip_in_a_file_is_one_line(tmp_path, untrained_core, old, new, message):
    assert old in FILE
    (tmp_path / "m.yaml").write_text(FILE.replace(old, new))
    with pytest.raises(TransferkitError, match=message) as error:
        wrap(untrained_core, TWO, match=tmp_path / "m.yaml")
    assert "\n" not in str(error.value)


@pytest.mark.parametrize(
    ("change", "message"),
    [
        ({"hold": 1.5}, "Expected `int`, got `float`"),
        ({"source": None}, "Expected `str`, got `null`"),
        ({"forces": "x"}, "Invalid enum value 'x'.*; known are acceleration, greater, load"),
        ({"copies": (Copy({"hinge_y": 1.0}),)}, "Expected `object`, got `float`"),
    ],
)
def test_a_match_made_in_python_is_held_to_the_same(tmp_path, untrained_core, change, message):
    pairing = replace(match(ONE, TWO), **change)
    with pytest.raises(ConfigError, match=f"the match is none: {message}"):
        wrap(untrained_core, TWO, match=pairing)
    with pytest.raises(ConfigError, match=f"the match is none: {message}"):
        save_match(pairing, tmp_path / "m.yaml")


def test_a_match_of_another_body_is_said(untrained_core, caplog):
    pairing = match(ONE, heavy := f"{TWO}?vary.mass=5.0")
    for target in (heavy, TWO):
        wrap(untrained_core, target, match=pairing)
    assert caplog.messages == [f"the match was made for {heavy}, and is used with {TWO}"]


def test_joints_that_a_model_calls_the_same_are_told_apart(untrained_core):
    copy = Copy({"hinge_y": {"hinge_y": 1.0, "slide_z": 4.0}}, {"drive.hinge_y2": {"drive.slide_x": 1.0}})
    text = wrap(untrained_core, "Humanoid-v5", match=Pairing(ONE, "Humanoid-v5", (copy,))).describe()
    assert "  joint hinge_y (hinge) = +1 root hinge_y +4 root slide_z" in text


@pytest.mark.parametrize("option", [{"adapter": "random"}, {"adapter": "pad"}, {"preset": "paper"}])
def test_a_match_that_has_no_effect_is_refused(untrained_core, option):
    with pytest.raises(ConfigError, match="has no effect"):
        wrap(untrained_core, TWO, match=match(ONE, TWO), **option)
