import torch

from tests.toys import only, transition
from transferkit.streams import Streams
from transferkit.trainers.dyna.replay import Batch, ReplayBuffer


def test_the_buffer_forgets_the_oldest_and_makes_the_round_trip():
    buffer = ReplayBuffer(1, 1, 3)
    for value in range(5):
        buffer.add(only(transition(float(value), 0.0, 0.0, 0.0, 0.0)), weight=float(value == 3))
    assert len(buffer) == 3
    assert buffer.recent(2).observation.flatten().tolist() == [3.0, 4.0]
    again = ReplayBuffer(1, 1, 3)
    again.restore(buffer.state())
    draws = [b.sample((4, 2), Streams(0).torch("test"), 0.5) for b in (buffer, again)]
    assert torch.equal(*draws)
    assert again.recent(3).observation.flatten().tolist() == [2.0, 3.0, 4.0]


def test_a_share_of_what_is_drawn_is_drawn_by_weight():
    buffer = ReplayBuffer(1, 1, 10)
    buffer.extend(rows(4), torch.tensor([0.0, 3.0, 1.0, 0.0]))
    drawn = buffer.sample((4000,), Streams(0).torch("test"), 0.5)[:, 0]
    # half evenly, a quarter of each; half by weight, three quarters and one
    shares = torch.bincount(drawn.long(), minlength=4) / 4000
    torch.testing.assert_close(shares, torch.tensor([0.125, 0.5, 0.25, 0.125]), atol=0.03, rtol=0.0)


def test_a_row_is_a_transition():
    buffer, batch = ReplayBuffer(1, 1, 10), transition(1.0, 2.0, 3.0, 4.0, 1.0)
    buffer.extend(batch)
    assert buffer.sample((1,), Streams(0).torch("test")).tolist() == [[1.0, 2.0, 3.0, 4.0, 1.0]]
    assert all(torch.equal(a, b) for a, b in zip(buffer.all(), batch, strict=True))


def rows(n, first=0):
    zeros = torch.zeros(n)
    return Batch(torch.arange(first, first + n).float()[:, None], zeros[:, None], zeros, zeros[:, None], zeros)


def test_a_buffer_takes_many_rows_and_keeps_the_newest():
    many, one = ReplayBuffer(1, 1, 3000), ReplayBuffer(1, 1, 3000)
    many.extend(rows(2500))
    many.extend(rows(1000, 2500))
    for row in range(3500):
        one.add(only(rows(1, row)))
    assert torch.equal(many.all().observation, one.all().observation)
    assert many.added == one.added == 3500
    few = ReplayBuffer(1, 1, 10)
    few.extend(rows(25))
    assert few.recent(10).observation.flatten().tolist() == list(range(15, 25))
