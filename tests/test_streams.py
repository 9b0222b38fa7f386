import pytest
import torch

from transferkit.errors import SettingError
from transferkit.streams import Streams


def test_streams_are_named_independent_and_repeatable():
    one, same, other = Streams(1), Streams(1), Streams(2)
    assert one.integer("a", 0, 1) == same.integer("a", 0, 1)
    seeds = {one.integer("a", 0, 1), one.integer("a", 1, 0), one.integer("b", 0, 1), other.integer("a", 0, 1)}
    assert len(seeds) == 4
    draws = [torch.rand(3, generator=stream.torch("a")) for stream in (one, same, other)]
    assert torch.equal(draws[0], draws[1])
    assert not torch.equal(draws[0], draws[2])
    numbers = [stream.numpy("a").random(3).tolist() for stream in (one, same, other)]
    assert numbers[0] == numbers[1] != numbers[2]


def test_a_negative_seed_is_refused():
    with pytest.raises(SettingError, match=r"^seed=-1 must be at least 0$"):
        Streams(-1)
