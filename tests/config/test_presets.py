"""Presets are frozen: results name them by version."""

import hashlib
import json
from dataclasses import asdict

import pytest

from transferkit.config import PRESETS, SECTIONS, USED, preset_version
from transferkit.errors import UnknownNameError

FROZEN = {
    "ppo default-v1": "39b5b1946311100f",
    "ppo default-v2": "998bfac91bead90d",
    "ppo default-v3": "f6f5f15fa92c81dd",
    "ppo default-v4": "f07b1806493c8a84",
    "ppo default-v5": "eae09f6473360e04",
    "ppo default-v6": "f2516f2a1c674ce1",
    "ppo default-v7": "802d850e22e6aa60",
    "ppo paper-v1": "8bc880cd76335a46",
    "dyna-ddpg default-v1": "6cbde9b74fd329a5",
    "dyna-ddpg default-v2": "b44ee18336838a2f",
    "dyna-ddpg default-v3": "859344475b5d25ad",
    "dyna-ddpg default-v4": "4a64e1d2ea9ba6e5",
    "dyna-ddpg default-v5": "505bc831552ebfe8",
    "dyna-ddpg default-v6": "080ba38e0aa76794",
    "dyna-ddpg paper-v1": "6ca1852377bf566d",
    "dyna-ppo default-v1": "39b5b1946311100f",
    "dyna-ppo default-v2": "2a63df0159173cd2",
    "dyna-ppo default-v3": "e95f1da6d8cde415",
    "dyna-ppo default-v4": "d073e7ebc9ed8586",
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
        ("dyna-ddpg", "default", "default-v6"),
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
