"""Presets are frozen: results name them by version."""

import hashlib
import json
from dataclasses import asdict

import pytest

from transferkit.config import PRESETS, SECTIONS, USED, preset_version
from transferkit.errors import UnknownNameError

FROZEN = {
    "ppo default-v1": "c88f0d27668b47ec",
    "ppo default-v2": "d7856e184fb84e25",
    "ppo default-v3": "3183c4e196466454",
    "ppo default-v4": "e0c1d60e5a36a84e",
    "ppo default-v5": "8f6c13b0d90d3fc3",
    "ppo default-v6": "05fe95a64dbcdf02",
    "ppo default-v7": "925535c87987edbe",
    "ppo paper-v1": "7688c6b2dabd7ae2",
    "dyna-ddpg default-v1": "0d061154f0149892",
    "dyna-ddpg default-v2": "fa5d25d148915690",
    "dyna-ddpg default-v3": "258b0b7c6dcfdc52",
    "dyna-ddpg default-v4": "2d98596ecbdbbdf1",
    "dyna-ddpg paper-v1": "3243b849b28473a5",
    "dyna-ppo default-v1": "c88f0d27668b47ec",
    "dyna-ppo default-v2": "f6a17f9c68c3af7b",
    "dyna-ppo default-v3": "f2c14623282d13cb",
    "dyna-ppo default-v4": "9df99e1996b8cacb",
}


def sha(preset):
    return hashlib.sha256(json.dumps(asdict(preset), sort_keys=True).encode()).hexdigest()[:16]


def test_no_version_of_a_preset_ever_changes():
    """Give a new default a version and a hash of its own; only a new setting, of no effect on old runs, may change a hash."""
    assert {f"{algo} {name}": sha(preset) for algo, versions in PRESETS.items() for name, preset in versions.items()} == FROZEN


@pytest.mark.parametrize(
    ("algo", "name", "version"),
    [
        ("ppo", "default", "default-v7"),
        ("ppo", "default-v1", "default-v1"),
        ("ppo", "paper", "paper-v1"),
        ("dyna-ddpg", "default", "default-v4"),
        ("dyna-ppo", "default", "default-v4"),
    ],
)
def test_a_name_without_a_version_is_the_newest(algo, name, version):
    assert preset_version(algo, name) == version


@pytest.mark.parametrize(
    ("algo", "name", "message"),
    [
        ("ppo", "papr", r"unknown preset of ppo 'papr'; did you mean paper or paper-v1\?"),
        ("ppo", "default-v9", "did you mean default-v7 or default-v6 or default-v5"),
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
