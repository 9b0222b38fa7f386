from dataclasses import replace

import pytest
import torch

from transferkit.errors import ConfigError, SettingError
from transferkit.nn import Linear
from transferkit.tensors import dump_tensors, parse_tensors


def test_controls_keep_what_they_claim_to_keep(untrained_core):
    shuffled, random = untrained_core.shuffled(0), untrained_core.randomized(0)
    name = "body.0.weight"
    a, b = untrained_core.components["policy"][name], shuffled.components["policy"][name]
    assert not torch.equal(a, b)
    assert torch.equal(a.flatten(1).sort().values, b.flatten(1).sort().values)
    assert not torch.equal(a, random.components["policy"][name])
    assert isinstance(random.network(1).mean_head, Linear)
    for control in (shuffled, random):
        assert torch.equal(control.components["normalizer"]["mean"], untrained_core.components["normalizer"]["mean"])


def test_a_shuffled_core_is_the_same_in_whatever_order_its_file_was_read(full_core):
    turned = {name: dict(reversed(tensors.items())) for name, tensors in full_core.components.items()}
    one, other = full_core.shuffled(3), replace(full_core, components=turned).shuffled(3)
    for component, tensors in one.components.items():
        assert all(torch.equal(tensor, other.components[component][name]) for name, tensor in tensors.items()), component


def test_tensors_are_read_in_the_order_of_their_names():
    names = [f"{k}.weight" for k in range(40)]
    blob = dump_tensors({name: torch.zeros(2) for name in reversed(names)}, {})
    assert list(parse_tensors(blob)[0]) == sorted(names)


def test_controls_share_no_trained_weights(full_core):
    for control in (full_core.randomized(0), full_core.shuffled(0)):
        for component in ("policy", "critic", "dynamics"):
            for name, tensor in control.components[component].items():
                varies = full_core.components[component][name].std() > 0
                assert not varies or not torch.equal(tensor, full_core.components[component][name]), (component, name)


def test_what_a_core_does_not_have_is_refused(untrained_core):
    with pytest.raises(ConfigError, match="core test-v1 has no critic"):
        untrained_core.critic()
    with pytest.raises(SettingError, match="member=2 must be 0 to 1 for core test-v1"):
        untrained_core.network(2)
