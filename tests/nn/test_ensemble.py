import pytest
import torch

from transferkit.nn import Ensemble, EnsembleArchitecture, EnsembleLinear
from transferkit.reading import typed
from transferkit.streams import Streams


def random(*shape):
    return torch.randn(*shape, generator=Streams(0).torch("x"))


def test_ensemble_members_are_independent():
    ensemble = Ensemble(EnsembleArchitecture(2, 3, 1, (8,)), Streams(0).torch("test"))
    x = random(5, 3)
    both = ensemble(x)
    torch.testing.assert_close(ensemble(torch.stack((x, x.flip(0))))[0], both[0])
    with torch.no_grad():
        ensemble.body[0].weight[1] += 1
    assert torch.equal(ensemble(x)[0], both[0])
    assert not torch.equal(ensemble(x)[1], both[1])


@pytest.mark.parametrize("out", [1, 2], ids=["one column, which is summed", "a product"])
def test_each_member_is_a_linear_layer(out):
    layer = EnsembleLinear(2, 3, out, Streams(0).torch("test"))
    x = random(2, 5, 3)
    expected = [x[k] @ layer.weight[k] + layer.bias[k] for k in range(2)]
    torch.testing.assert_close(layer(x), torch.stack(expected))
    assert layer.weight.abs().max() <= 3**-0.5


def test_hidden_layers_are_normalised_before_they_are_rectified():
    ensemble = Ensemble(EnsembleArchitecture(1, 1, 1, (2,)))
    with torch.no_grad():
        ensemble.body[0].weight[0] = torch.tensor([[1.0, 3.0]])
    # 5 and 15: mean 10, deviation 5
    torch.testing.assert_close(ensemble.features(torch.tensor([[5.0]]))[0, 0], torch.tensor([0.0, 1.0]))
    plain = Ensemble(EnsembleArchitecture(1, 1, 1, (2,), layer_norm=False))
    plain.load_state_dict(ensemble.state_dict())
    assert plain.features(torch.tensor([[-5.0], [5.0]]))[0].tolist() == [[0.0, 0.0], [5.0, 15.0]]


def test_a_head_can_be_zeroed_or_handed_over():
    ensemble = Ensemble(EnsembleArchitecture(2, 3, 1, (8,)), Streams(0).torch("test"))
    x = random(5, 3)
    features, before = ensemble.features(x), ensemble(x)
    head = ensemble.take_head()
    assert torch.equal(ensemble(x), features)
    assert torch.equal(head(features), before)
    ensemble.head = head
    ensemble.zero_head()
    assert not ensemble(x).any()


def test_an_architecture_makes_the_round_trip():
    architecture = EnsembleArchitecture(2, 3, 1, (8, 8), layer_norm=False)
    assert typed({**architecture.to_json(), "hidden": [8, 8]}, EnsembleArchitecture) == architecture
