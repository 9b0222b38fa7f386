"""Presets are frozen: results name them by version."""

import hashlib
import json
from dataclasses import asdict

import pytest

from transferkit.config import PRESETS, SECTIONS, USED, preset_version
from transferkit.errors import UnknownNameError

FROZEN = {
    "ppo default-v1": "66e969ff331a942d",
    "ppo default-v2": "d8a5969ee3457b6c",
    "ppo default-v3": "555c1a3245a1a85f",
    "ppo default-v4": "418f01d3dbb6708e",
    "ppo default-v5": "ef2df0185df62455",
    "ppo default-v6": "11a27c433e0a5ff3",
    "ppo paper-v1": "29adefa06f7c9ef8",
    "dyna-ddpg default-v1": "ebe6eb20001ac35c",
    "dyna-ddpg default-v2": "b916284ac5bcbbde",
    "dyna-ddpg default-v3": "e2dc9970876cb662",
    "dyna-ddpg paper-v1": "31b881eb9d92db74",
    "dyna-ppo default-v1": "66e969ff331a942d",
    "dyna-ppo default-v2": "aa2687d60dfcb68f",
    "dyna-ppo default-v3": "648deb898fe8225d",
}


def sha(preset):
    return hashlib.sha256(json.dumps(asdict(preset), sort_keys=True).encode()).hexdigest()[:16]


def test_no_version_of_a_preset_ever_changes():
    """Give a new default a version and a hash of its own; only a new setting, of no effect on old runs, may change a hash."""
    assert {f"{algo} {name}": sha(preset) for algo, versions in PRESETS.items() for name, preset in versions.items()} == FROZEN


@pytest.mark.parametrize(
    ("algo", "name", "version"),
    [
        ("ppo", "default", "default-v6"),
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
        ("ppo", "default-v9", "did you mean default-v6 or default-v5 or default-v4"),
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
