"""Adapters of a sandwich: from a target's observation to a core's input, and from the core to a target's action."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING

import torch
from torch import Tensor, nn

from transferkit.nn import Linear, Shared

if TYPE_CHECKING:
    from transferkit.matching import Match
    from transferkit.nn import Normalizer


class InputAdapter(nn.Module):
    """Target observations `(B, d_target)` to core inputs `(B, copies * d_source)` in the core's normalised units.

    `linear(normalised observation)`, plus, if the two specs match, the matched physical quantity under the core's own
    source statistics. With a match the linear map starts at zero, so the sum starts at exactly what the match says, and
    learns a correction in well-scaled units.
    """

    sin: Tensor
    cos: Tensor
    """Where the sines and cosines of angles stand in observations."""
    weight: Tensor
    bias: Tensor
    form: Tensor
    """`(3, copies * d_source)`: 1 if a core input is linear, a sine, a cosine of the matched quantity."""

    def __init__(
        self,
        normalizer: Normalizer,
        source_normalizer: Normalizer | None,
        d_source: int,
        match: Match | None,
        generator: torch.Generator | None,
    ) -> None:
        super().__init__()
        d_target = normalizer.mean.shape[0]
        self.semantic = match is not None
        self.copies = 1 if match is None else match.copies
        self.linear = Linear(d_target, self.copies * d_source, None if self.semantic else generator, gain=1.0)
        self._normalize, self._normalize_source = Shared(normalizer), Shared(source_normalizer)  # the policy owns both
        if match is not None:
            self.register_buffer("sin", torch.tensor(match.sin, dtype=torch.int64), persistent=False)
            self.register_buffer("cos", torch.tensor(match.cos, dtype=torch.int64), persistent=False)
            self.register_buffer("weight", torch.tensor(match.weight), persistent=False)
            self.register_buffer("bias", torch.tensor(match.bias), persistent=False)
            rows = [[float(form == kind) for form in match.form] for kind in ("linear", "sin", "cos")]
            self.register_buffer("form", torch.tensor(rows), persistent=False)

    def forward(self, observation: Tensor) -> Tensor:
        """Compute core inputs."""
        adapted = self.linear(self._normalize(observation))
        if not self.semantic:
            return adapted
        matched = self.matched(observation)
        each = matched.unflatten(-1, (self.copies, -1))
        return adapted + self._normalize_source(each).flatten(-2) * self.form.sum(0)

    def matched(self, observation: Tensor) -> Tensor:
        """Compute matched quantities in the source's physical units, `(..., copies * d_source)`; zero if nothing matched."""
        atan2 = exported_atan2 if torch.compiler.is_exporting() else torch.atan2
        angles = atan2(observation[..., self.sin], observation[..., self.cos])
        z = torch.cat([observation, angles], -1) @ self.weight.T + self.bias
        return self.form[0] * z + self.form[1] * z.sin() + self.form[2] * z.cos()


def exported_atan2(y: Tensor, x: Tensor) -> Tensor:
    """`torch.atan2` of operations that ONNX has: what torch exports is wrong on both axes."""
    below = (y < 0) | ((y == 0) & (1 / y < 0))
    half_turn = torch.where(below, -math.pi, math.pi)
    angle = torch.atan(y / torch.where(x == 0, 1.0, x)) + torch.where(x < 0, half_turn, 0.0)
    return torch.where((x == 0) & (y != 0), half_turn / 2, angle)


def output_adapter(
    d_in: int, act_dim: int, match: Match | None, head: nn.Linear | None, generator: torch.Generator | None
) -> Linear:
    """Make the map from the tapped copies of the core `(B, copies * d_in)` to the mean action `(B, act_dim)`.

    Random: orthogonal with gain 0.01 on features (a new policy acts near zero), 1 on the core's action. With a match:
    the core's own action head under the features tap, the matched actuators under the action tap, zero elsewhere.
    """
    if match is None:
        return Linear(d_in, act_dim, generator, gain=0.01 if head is not None else 1.0)
    adapter = Linear(match.copies * d_in, act_dim)
    weight = torch.tensor(match.action_weight)
    with torch.no_grad():
        if match.action_bias:
            adapter.bias.copy_(torch.tensor(match.action_bias))
        adapter.weight.copy_(weight if head is None else weight @ torch.block_diag(*[head.weight] * match.copies))
        if head is not None:
            adapter.bias.add_(weight @ head.bias.repeat(match.copies))
    return adapter
