"""Presets are frozen: results name them by version."""

import hashlib
import json
from dataclasses import asdict

import pytest

from transferkit.config import PRESETS, SECTIONS, USED, preset_version
from transferkit.errors import UnknownNameError

FROZEN = {
    "ppo default-v1": "7e3b3db0028672e8",
    "ppo default-v2": "7539ea09e6c580d9",
    "ppo default-v3": "2d43fcafea1dd921",
    "ppo default-v4": "2546580d6af2bafd",
    "ppo default-v5": "b2ab8a07d7d46f5b",
    "ppo default-v6": "8d602c37c6c5894e",
    "ppo default-v7": "6da1d9413056bb0f",
    "ppo paper-v1": "a5366d3cfecc1766",
    "dyna-ddpg default-v1": "269ac6419032617d",
    "dyna-ddpg default-v2": "9b2dc34ff32b0f3b",
    "dyna-ddpg default-v3": "7e845e1d6d91ef92",
    "dyna-ddpg default-v4": "9b0d6b15e98be115",
    "dyna-ddpg default-v5": "3f53dbc4441774d5",
    "dyna-ddpg paper-v1": "98b7ec72ae2271de",
    "dyna-ppo default-v1": "7e3b3db0028672e8",
    "dyna-ppo default-v2": "daf68d25c84d0e54",
    "dyna-ppo default-v3": "6d52ac3453977010",
    "dyna-ppo default-v4": "3fc74feee2b572f9",
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
        ("dyna-ddpg", "default", "default-v5"),
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
