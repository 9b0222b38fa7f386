"""Presets are frozen: results name them by version."""

import hashlib
import json
from dataclasses import asdict

import pytest

from transferkit.config import PRESETS, SECTIONS, USED, preset_version
from transferkit.errors import UnknownNameError

FROZEN = {
    "ppo default-v1": "6fd9883f186612ce",
    "ppo default-v2": "f22e32a7c0198f24",
    "ppo default-v3": "9c2bfc4208c5fd08",
    "ppo default-v4": "69da3fe3a6a40f03",
    "ppo paper-v1": "0d0354db47169fec",
    "dyna-ddpg default-v1": "ca4d4727e513bf47",
    "dyna-ddpg default-v2": "1a113462b849479c",
    "dyna-ddpg default-v3": "956995274f668380",
    "dyna-ddpg paper-v1": "4d98c27b51e35be5",
    "dyna-ppo default-v1": "6fd9883f186612ce",
    "dyna-ppo default-v2": "c34e5f59c18bc61a",
    "dyna-ppo default-v3": "d785e094cee85366",
}


def sha(preset):
    return hashlib.sha256(json.dumps(asdict(preset), sort_keys=True).encode()).hexdigest()[:16]


def test_no_version_of_a_preset_ever_changes():
    """Give a new default a version and a hash of its own; only a new setting, of no effect on old runs, may change a hash."""
    assert {f"{algo} {name}": sha(preset) for algo, versions in PRESETS.items() for name, preset in versions.items()} == FROZEN


@pytest.mark.parametrize(
    ("algo", "name", "version"),
    [
        ("ppo", "default", "default-v4"),
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
        ("ppo", "default-v9", "did you mean default-v4 or default-v3 or default-v2"),
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
