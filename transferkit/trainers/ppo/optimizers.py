"""Several optimisers behind the interface of one, as rsl_rl expects it."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from transferkit.nn import Part, PartAdam


class Optimizers:
    """Their parts, groups and state, one after the other."""

    def __init__(self, optimizers: Sequence[PartAdam]) -> None:
        self._each = optimizers

    @property
    def parts(self) -> list[Part]:
        """All parts."""
        return [part for optimizer in self._each for part in optimizer.parts]

    @property
    def param_groups(self) -> list[dict[str, Any]]:
        """All groups."""
        return [group for optimizer in self._each for group in optimizer.param_groups]

    def state_dict(self) -> dict[str, Any]:
        """Join the states' lists."""
        states = [optimizer.state_dict() for optimizer in self._each]
        return {name: [item for state in states for item in state[name]] for name in states[0]}

    def load_state_dict(self, state: dict[str, Any]) -> None:
        """Take what `state_dict` returned."""
        first = 0
        for optimizer in self._each:
            last = first + len(optimizer.parts)
            optimizer.load_state_dict({name: items[first:last] for name, items in state.items()})
            first = last
