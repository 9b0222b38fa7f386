"""How firmly what is learnt around a core is held to what that did at first."""

from __future__ import annotations

from collections.abc import Mapping
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from transferkit.config import DynaConfig

MOST_HALVINGS = 10.0
"""How often the anchor halves at most: more would take too long to undo."""


class Anchor:
    """The `weight` of the distance to the first policy: by the run's own evidence if there is any, else less with time."""

    def __init__(self, config: DynaConfig) -> None:
        self._config, self.weight = config, config.anchor
        self._progress, self._halvings = 0.0, 0.0

    def follow(self, progress: float, *, behind: bool | None) -> None:
        """Hold a run that has used this share of its budget; None if it is not known whether it is `behind` its core."""
        config = self._config
        since = max(0.0, progress - self._progress)  # a larger budget makes the share smaller, which changes no hold
        self._progress = progress
        if not config.anchor_halves or behind is None:
            share = 1.0 if behind and config.anchor_holds else 1.0 - progress
        else:
            halvings = since / config.anchor_halves
            self._halvings = min(max(0.0, self._halvings + (-halvings if behind else halvings)), MOST_HALVINGS)
            share = 2.0**-self._halvings
        self.weight = config.anchor * share

    def state(self) -> dict[str, float]:
        """Return what the next hold depends on."""
        return {"progress": self._progress, "halvings": self._halvings}

    def restore(self, state: Mapping[str, Any]) -> None:
        """Take what `state` returned."""
        self._progress, self._halvings = float(state.get("progress", 0.0)), float(state.get("halvings", 0.0))
