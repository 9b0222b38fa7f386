"""A core of a family acts on every body of it as it did when it was trained."""

from dataclasses import replace

import pytest

from transferkit import derive_spec
from transferkit.matching import compiled, explain, pair
from transferkit.matching.family import Family, family_of

HOPPER = "Hopper-v5"
FAMILY = f"{HOPPER}?vary.mass=[0.7,1.3]&vary.length=[0.7,1.3]&vary.gear=[0.7,1.3]"


def family(env_id=FAMILY):
    return replace(derive_spec(HOPPER), env_id=env_id)


def factors(change, source=None):
    pairing = pair(source or family(), derive_spec(f"{HOPPER}?vary.{change}"), forces="greater")
    return pairing.length, [factor for drives in pairing.copies[0].actions.values() for factor in drives.values()]


@pytest.mark.parametrize("change", ["mass=0.7", "mass=1.3", "length=0.7", "length=1.3", "damping=2", "friction=2"])
def test_nothing_is_scaled_to_a_body_of_the_family(change):
    assert factors(change) == (1.0, pytest.approx([1.0] * 3))


@pytest.mark.parametrize("change", ["length=0.6", "length=1.5", "mass=2"])
def test_another_body_is_scaled_to_as_from_one_body(change):
    assert factors(change) == factors(change, derive_spec(HOPPER)) != (1.0, pytest.approx([1.0] * 3))


def test_a_weaker_motor_gets_more_of_the_action():
    assert factors("gear=0.8") == (1.0, pytest.approx([1.25] * 3))
    assert factors("mass=1.3&vary.gear=0.8") == (1.0, pytest.approx([1.25] * 3))


def test_factors_are_of_the_body_that_the_spec_describes():
    hopper = derive_spec(HOPPER)
    assert family_of(family(), hopper) == Family((0.7, 1.3), (pytest.approx(0.49), pytest.approx(1.69)))
    assert family_of(family(f"{HOPPER}?vary.length=[1.4,1.6]"), hopper).lengths == pytest.approx((1.4 / 1.5, 1.6 / 1.5))
    for name in (
        HOPPER,
        f"{HOPPER}?vary.mass=2",
        f"{HOPPER}?vary.length.thigh=[0.7,1.3]",
        "<Varied of me?>",
        "a?b",
        "?vary.x=1",
    ):
        assert family_of(family(name), hopper) == Family()


def test_another_robot_is_no_body_of_the_family():
    walker, (one, other) = derive_spec("Walker2d-v5"), (family(), derive_spec(HOPPER))
    assert family_of(one, walker) == Family()
    assert pair(one, walker, forces="greater").copies == pair(other, walker, forces="greater").copies


def test_a_match_says_what_its_core_has_met():
    target = derive_spec(f"{HOPPER}?vary.length=0.8")
    for source, line in ((family(), "lengths of 0.7 to 1.3 and masses of 0.49 to 1.69"), (derive_spec(HOPPER), "")):
        text = explain(compiled(pair(source, target), source, target), source, target)
        assert line in text
        assert ("family" in text) == bool(line)
