"""Adapters by hand: a target that observes a position, a sine and a cosine, around a core of a position and an angle."""

import math

import pytest
import torch
from torch import nn

from transferkit.matching import Match
from transferkit.nn import Normalizer
from transferkit.policy.adapters import InputAdapter, output_adapter
from transferkit.streams import Streams

OBSERVATION = torch.tensor([[3.0, 0.6, 0.8]])
ANGLE = math.atan2(0.6, 0.8)


def matched(form=("linear", "linear"), action_weight=((2.0,), (0.0,))):
    """Core inputs are twice the position plus one, and the angle; the core's action drives action 0 of two, doubled."""
    weight = ((2.0, 0.0, 0.0, 0.0), (0.0, 0.0, 0.0, 1.0))
    return Match((1,), (2,), weight, (1.0, 0.0), form, action_weight)


def statistics(mean, var):
    normalizer = Normalizer(len(mean))
    normalizer.load_state_dict({"mean": torch.tensor(mean), "var": torch.tensor(var), "count": torch.tensor(10.0)})
    return normalizer


@pytest.mark.parametrize(
    ("form", "expected"),
    [
        (("linear", "linear"), (7.0, ANGLE)),
        (("linear", "sin"), (7.0, 0.6)),
        (("linear", "cos"), (7.0, 0.8)),
        (("none", "linear"), (0.0, ANGLE)),
    ],
    ids=["as they are", "sine", "cosine", "nothing"],
)
def test_matched_quantities_are_in_the_sources_units(form, expected):
    adapter = InputAdapter(statistics([0.0] * 3, [1.0] * 3), None, 2, matched(form), None)
    assert adapter.matched(OBSERVATION)[0].tolist() == pytest.approx(expected, abs=1e-6)
    torch.testing.assert_close(adapter(OBSERVATION), adapter.matched(OBSERVATION))


def test_a_matched_adapter_starts_at_the_match_under_the_cores_statistics_and_learns_a_correction():
    target, source = statistics([1.0, 0.0, 0.0], [4.0, 1.0, 1.0]), statistics([1.0, 0.0], [9.0, 0.25])
    adapter = InputAdapter(target, source, 2, matched(), Streams(0).torch("not drawn from"))
    start = [(7 - 1) / 3, ANGLE / 0.5]
    assert adapter(OBSERVATION)[0].tolist() == pytest.approx(start, abs=1e-5)
    with torch.no_grad():
        adapter.linear.weight[1] = torch.tensor([5.0, 0.0, 0.0])
    assert adapter(OBSERVATION)[0].tolist() == pytest.approx([start[0], start[1] + 5 * (3 - 1) / 2], abs=1e-5)


def test_what_nothing_means_stays_zero_whatever_the_cores_statistics():
    adapter = InputAdapter(
        statistics([0.0] * 3, [1.0] * 3), statistics([9.0, 0.0], [1.0, 1.0]), 2, matched(("none", "sin")), None
    )
    assert adapter(OBSERVATION)[0].tolist() == pytest.approx([0.0, 0.6], abs=1e-6)


def test_without_a_match_the_normalised_observation_is_mapped_at_random():
    adapter = InputAdapter(statistics([1.0, 0.0, 0.0], [4.0, 1.0, 1.0]), None, 2, None, Streams(0).torch("x"))
    weight = adapter.linear.weight
    torch.testing.assert_close(weight @ weight.T, torch.eye(2))
    torch.testing.assert_close(adapter(OBSERVATION), torch.tensor([[1.0, 0.6, 0.8]]) @ weight.T)


def test_an_adapter_saves_only_what_it_learns():
    adapter = InputAdapter(statistics([0.0] * 3, [1.0] * 3), statistics([0.0] * 2, [1.0] * 2), 2, matched(), None)
    assert set(adapter.state_dict()) == {"linear.weight", "linear.bias"}


def head():
    layer = nn.Linear(3, 1)
    with torch.no_grad():
        layer.weight.copy_(torch.tensor([[1.0, -2.0, 3.0]]))
        layer.bias.fill_(0.5)
    return layer


def test_behind_the_features_a_match_is_the_cores_own_head_scaled():
    adapter = output_adapter(3, 2, matched(), head(), None)
    assert adapter.weight.tolist() == [[2.0, -4.0, 6.0], [0.0, 0.0, 0.0]]
    assert adapter.bias.tolist() == [1.0, 0.0]


def test_behind_the_action_a_match_is_its_scale():
    adapter = output_adapter(1, 2, matched(), None, None)
    assert adapter.weight.tolist() == [[2.0], [0.0]]
    assert adapter.bias.tolist() == [0.0, 0.0]


@pytest.mark.parametrize(("tapped_head", "gain"), [(head(), 0.01), (None, 1.0)], ids=["features", "action"])
def test_a_random_output_is_orthogonal_and_small_on_features(tapped_head, gain):
    weight = output_adapter(8, 2, None, tapped_head, Streams(0).torch("x")).weight
    torch.testing.assert_close(weight @ weight.T, gain**2 * torch.eye(2))
