"""Presets are frozen: results name them by version."""

import hashlib
import json
from dataclasses import asdict

import pytest

from transferkit.config import PRESETS, SECTIONS, USED, preset_version
from transferkit.errors import UnknownNameError

FROZEN = {
    "ppo default-v1": "70a8a14206963cf1",
    "ppo default-v2": "8de8052e77c55157",
    "ppo default-v3": "554a9d44b9a04075",
    "ppo default-v4": "0f9ada507abbba1f",
    "ppo default-v5": "564f63ccc9ceb5d6",
    "ppo paper-v1": "6a72f34d48203e4e",
    "dyna-ddpg default-v1": "573a1a16237533d8",
    "dyna-ddpg default-v2": "b5eb66bceeb313ab",
    "dyna-ddpg default-v3": "d5a0c6cfb6d749d9",
    "dyna-ddpg paper-v1": "e7658a66139465f9",
    "dyna-ppo default-v1": "70a8a14206963cf1",
    "dyna-ppo default-v2": "53dc7af3c36f5b8d",
    "dyna-ppo default-v3": "cf8087d2fb8dcc6d",
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
