"""Presets are frozen: results name them by version."""

import hashlib
import json
from dataclasses import asdict

import pytest

from transferkit.config import PRESETS, SECTIONS, USED, preset_version
from transferkit.errors import UnknownNameError

FROZEN = {
    "ppo default-v1": "92774019ab055963",
    "ppo default-v2": "e61468922c236b48",
    "ppo default-v3": "1139c09cb0e2a52c",
    "ppo default-v4": "b1aa68f2a32a5fe0",
    "ppo default-v5": "f217e5c454bbb51c",
    "ppo paper-v1": "01eb62b90ea64b12",
    "dyna-ddpg default-v1": "02a3690463792ded",
    "dyna-ddpg default-v2": "2ea38113f7d41e9f",
    "dyna-ddpg default-v3": "36c54bb641f736fb",
    "dyna-ddpg paper-v1": "5fcb476a42d79217",
    "dyna-ppo default-v1": "92774019ab055963",
    "dyna-ppo default-v2": "c894fa1f35427180",
    "dyna-ppo default-v3": "0b1146df8797e853",
}


def sha(preset):
    return hashlib.sha256(json.dumps(asdict(preset), sort_keys=True).encode()).hexdigest()[:16]


def test_no_version_of_a_preset_ever_changes():
    """Give a new default a version and a hash of its own; only a new setting, of no effect on old runs, may change a hash."""
    assert {f"{algo} {name}": sha(preset) for algo, versions in PRESETS.items() for name, preset in versions.items()} == FROZEN


@pytest.mark.parametrize(
    ("algo", "name", "version"),
    [
        ("ppo", "default", "default-v5"),
        ("ppo", "default-v1", "default-v1"),
        ("ppo", "paper", "paper-v1"),
        ("dyna-ddpg", "default", "default-v3"),
        ("dyna-ppo", "default", "default-v3"),
    ],
)
def test_a_name_without_a_version_is_the_newest(algo, name, version):
    assert preset_version(algo, name) == version


@pytest.mark.parametrize(
    ("algo", "name", "message"),
    [
        ("ppo", "papr", r"unknown preset of ppo 'papr'; did you mean paper or paper-v1\?"),
        ("ppo", "default-v9", "did you mean default-v5 or default-v4 or default-v3"),
        ("dyna-ppo", "paper", r"unknown preset of dyna-ppo 'paper'; known are default, default-v1, default-v2"),
    ],
    ids=["misspelt", "a version there is not", "not of this trainer"],
)
def test_an_unknown_preset_is_refused_with_what_there_is(algo, name, message):
    with pytest.raises(UnknownNameError, match=message):
        preset_version(algo, name)


def test_each_trainer_reads_sections_that_there_are():
    assert set(USED) == set(PRESETS)
    assert all(set(sections) <= set(SECTIONS) for sections in USED.values())
    assert set().union(*USED.values()) == set(SECTIONS)
