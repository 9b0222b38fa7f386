"""Presets are frozen: results name them by version."""

import hashlib
import json
from dataclasses import asdict

import pytest

from transferkit.config import PRESETS, SECTIONS, USED, preset_version
from transferkit.errors import UnknownNameError

FROZEN = {
    "ppo default-v1": "68664f21dede2a9a",
    "ppo default-v2": "ba46e337cfcd28f8",
    "ppo default-v3": "ba3e0fee65b34538",
    "ppo default-v4": "543073404eb99e18",
    "ppo default-v5": "8d0bd8700989ba28",
    "ppo default-v6": "0e4f325a0abc1c4c",
    "ppo default-v7": "2b06f9633bda6058",
    "ppo default-v8": "c56c75123dbde088",
    "ppo paper-v1": "946bf826107ce922",
    "dyna-ddpg default-v1": "2d97eba6cb150371",
    "dyna-ddpg default-v2": "d2eafbb0347dd493",
    "dyna-ddpg default-v3": "a76d0c0f31391634",
    "dyna-ddpg default-v4": "9aef9a4d88e3ddf5",
    "dyna-ddpg default-v5": "5d14aa4a6d5f53d5",
    "dyna-ddpg default-v6": "a2086750eff4795c",
    "dyna-ddpg default-v7": "bd49389d2cea23f9",
    "dyna-ddpg paper-v1": "933a01a5955ba9b1",
    "dyna-ppo default-v1": "68664f21dede2a9a",
    "dyna-ppo default-v2": "cf0fb9c5a7465e58",
    "dyna-ppo default-v3": "374230c927352811",
    "dyna-ppo default-v4": "a5156a729b4dd02e",
}


def sha(preset):
    return hashlib.sha256(json.dumps(asdict(preset), sort_keys=True).encode()).hexdigest()[:16]


def test_no_version_of_a_preset_ever_changes():
    """Give a new default a version and a hash of its own; only a new setting, of no effect on old runs, may change a hash."""
    assert {f"{algo} {name}": sha(preset) for algo, versions in PRESETS.items() for name, preset in versions.items()} == FROZEN


@pytest.mark.parametrize(
    ("algo", "name", "version"),
    [
        ("ppo", "default", "default-v8"),
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
        ("ppo", "default-v9", "did you mean default-v8 or default-v7 or default-v6"),
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
