import pytest

from transferkit import wrap
from transferkit.policy.match import match

IDP, CARTPOLE = "InvertedDoublePendulum-v5", "dm_control/cartpole-balance-v0"


def test_the_way_back_turns_an_angle_into_its_sine_and_cosine(specs):
    found = match(specs[CARTPOLE], specs["InvertedPendulum-v5"])
    assert found.form == ("linear", "cos", "sin", "linear", "linear")
    assert found.scale == pytest.approx(5 / 3, rel=1e-4)


def test_what_cannot_be_matched_is_said(untrained_core, specs):
    text = wrap(untrained_core, specs[IDP]).describe()
    assert "atan2(hinge_y.sin, hinge_y.cos)" in text
    assert "hinge_y -> hinge_y" in text
    back = match(specs[IDP], specs["InvertedPendulum-v5"])
    unmatched = [e.name for e, form in zip(specs[IDP].observation, back.form, strict=True) if form == "none"]
    assert unmatched == ["hinge_y2.sin", "hinge_y2.cos", "hinge_y2.velocity", "observation[8]"]


def test_hanging_is_not_upright(specs):
    """Pendulums only match where the load rests on the same side of the hinge."""
    source = specs["InvertedPendulum-v5"]
    joints = [j if j.type == "slide" else type(j)(**{**j.__dict__, "rest": (0.0, 0.0, -1.0)}) for j in source.joints]
    hanging = type(source)(**{**source.__dict__, "joints": tuple(joints)})
    assert match(source, hanging).joints == {"slide_x": "slide_x"}
