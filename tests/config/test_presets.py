"""Presets are frozen: results name them by version."""

import hashlib
import json
from dataclasses import asdict

import pytest

from transferkit.config import PRESETS, SECTIONS, USED, preset_version
from transferkit.errors import UnknownNameError

FROZEN = {
    "ppo default-v1": "9b43719e5c750dee",
    "ppo default-v2": "6282a15d0eb89557",
    "ppo default-v3": "cf6e8a3af3059941",
    "ppo default-v4": "cfe0ec5d4d4ff08b",
    "ppo default-v5": "9cd8adae2edcf248",
    "ppo default-v6": "87414b2e1fd0f398",
    "ppo default-v7": "a9e5955617defed7",
    "ppo paper-v1": "ee3f51e1fa8b5c91",
    "dyna-ddpg default-v1": "eb68a7476a5f006f",
    "dyna-ddpg default-v2": "bc9face82623c65f",
    "dyna-ddpg default-v3": "06f7859d45b4fef5",
    "dyna-ddpg paper-v1": "9bc77e1a129613bc",
    "dyna-ppo default-v1": "9b43719e5c750dee",
    "dyna-ppo default-v2": "9f0174002175878a",
    "dyna-ppo default-v3": "214ce1d42c49ab67",
    "dyna-ppo default-v4": "aa8ed785436f9f3f",
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
        ("dyna-ddpg", "default", "default-v3"),
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
