"""From an environment's numbers to those that a descriptor says a policy takes, and from its outputs to the environment's."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

from transferkit.descriptors.compare import driven, observed

if TYPE_CHECKING:
    from transferkit.descriptors.form import Descriptor
    from transferkit.spec import IOSpec


@dataclass(frozen=True)
class Remap:
    """Number `k` of the policy is `scale[k] * observation[source[k]] + shift[k]`."""

    source: tuple[int, ...]
    scale: tuple[float, ...]
    shift: tuple[float, ...]
    outputs: tuple[int, ...]
    """Which output of the policy is action `k`."""
    units: tuple[float, ...]
    """What an output of 1 is, in the environment's units of action `k`."""

    @property
    def moves(self) -> bool:
        """Whether anything but the unit of actions changes."""
        plain = set(self.scale) <= {1.0} and set(self.shift) <= {0.0}
        return not plain or any(list(order) != sorted(order) for order in (self.source, self.outputs))


def remap(descriptor: Descriptor, spec: IOSpec) -> Remap | None:
    """Find every number of the descriptor in the environment; None if one is not there, or one of it is left over."""
    found, pushed = observed(spec), driven(spec)
    source, scale, shift = [], [], []
    for k, channel in enumerate(descriptor.observation):
        known = channel.kind not in ("other", "gravity", "last action")
        places = [j for j, one in enumerate(found) if one.is_of(channel)] if known else [k]
        if not places or places[0] >= len(found) or not found[places[0]].scale:
            return None
        measured = found[places[0]]
        source.append(places[0])
        scale.append(channel.scale / measured.scale if known else 1.0)
        shift.append(channel.scale * (measured.zero - channel.zero) + 0.0 if known else 0.0)
    outputs = [[j for j, channel in enumerate(descriptor.action) if one.is_of(channel)] for one in pushed]
    each = sorted(at[0] for at in outputs if at) == list(range(spec.act_dim)) and len(descriptor.action) == spec.act_dim
    idle = any(channel.zero for channel in descriptor.action)  # an output of 0 is a command, which no order or unit mends
    if sorted(source) != list(range(spec.obs_dim)) or not each or idle or not all(one.scale for one in pushed):
        return None
    units = tuple(descriptor.action[at[0]].scale / one.scale for at, one in zip(outputs, pushed, strict=True))
    return Remap(tuple(source), tuple(scale), tuple(shift), tuple(at[0] for at in outputs), units)
