"""Presets are frozen: results name them by version."""

import hashlib
import json
from dataclasses import asdict

import pytest

from transferkit.config import PRESETS, SECTIONS, USED, preset_version
from transferkit.errors import UnknownNameError

FROZEN = {
    "ppo default-v1": "be2480284395e562",
    "ppo default-v2": "24a14fd1d516f3b0",
    "ppo default-v3": "a4899e818abfe25c",
    "ppo default-v4": "6cb56ab82479751b",
    "ppo default-v5": "2909667302ab63ee",
    "ppo default-v6": "4a1444fdc2507eec",
    "ppo default-v7": "210c063a25a6d828",
    "ppo paper-v1": "7df36f8a4b8434b6",
    "dyna-ddpg default-v1": "ce61c998ffd08893",
    "dyna-ddpg default-v2": "64d3f5dcfe75038b",
    "dyna-ddpg default-v3": "09828932f19d4090",
    "dyna-ddpg default-v4": "91b5da056f4ae55d",
    "dyna-ddpg default-v5": "9893c0abb1eac194",
    "dyna-ddpg default-v6": "42945601de163b99",
    "dyna-ddpg default-v7": "4f21998109513b62",
    "dyna-ddpg paper-v1": "69c749024a0edee7",
    "dyna-ppo default-v1": "be2480284395e562",
    "dyna-ppo default-v2": "ddd86fbf3e64c90c",
    "dyna-ppo default-v3": "25f4a1f1a62ff966",
    "dyna-ppo default-v4": "555b40b45d8fe706",
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
        ("dyna-ddpg", "default", "default-v7"),
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
