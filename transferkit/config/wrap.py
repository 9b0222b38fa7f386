"""Settings of the sandwich."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Literal

from transferkit.config.names import Preset, check_choices
from transferkit.errors import ConfigError


@dataclass(frozen=True)
class WrapConfig:
    """How a core is built into the policy of another environment."""

    structure: Literal["default", "paper"] = "default"
    """The healthy sandwich, or the paper's with its ReLUs and its shared output layer."""
    tap: Literal["features", "action"] = "features"
    """Take the core's last hidden layer, or its action output as the paper does."""
    adapter: Literal["auto", "semantic", "random", "pad"] = "auto"
    """Fill the adapters from what the numbers mean, at random, or (a control) element by element with zeros for what lacks;
    auto is semantic where anything matches, else random."""
    finetune: bool = True
    """Square residual layers beside the core, the identity until trained."""
    residual: int = 64
    """Width of a side network from the observation straight to the action, zero at the start (Rusu et al. 2016); 0 for none. A
    core sees no more elements than its source had: without a way around it, larger robots are hardly learnt."""
    freeze: Mapping[str, float] = field(default_factory=dict)
    """For each part (`core`, `input_adapter`, ...) the share of the budget during which it does not learn: 1 for all of
    it, 0.5 to unfreeze it half way."""
    lr_scale: Mapping[str, float] = field(default_factory=lambda: {"core": 0.3})
    """Learning rate of a part as a multiple of the trainer's."""

    def __post_init__(self) -> None:
        check_choices(self)
        for part, share in self.freeze.items():
            if not isinstance(share, int | float) or not 0 <= share <= 1:
                raise ConfigError(f"freeze {part}={share!r} must lie between 0 and 1; 1 freezes it for the whole budget")
        for part, scale in self.lr_scale.items():
            if not isinstance(scale, int | float) or not scale > 0:
                raise ConfigError(f"lr_scale {part}={scale!r} must be above 0; use freeze to stop a part from learning")
        if self.residual < 0:
            raise ConfigError(f"residual={self.residual} must be 0 or a width")


WRAP_PRESETS: dict[Preset, WrapConfig] = {
    "default": WrapConfig(),
    "paper": WrapConfig(structure="paper", tap="action", adapter="random", residual=0, lr_scale={"core": 1 / 3}),
}
"""`paper`: core at 1e-4 of 3e-4, as on InvertedDoublePendulum; on Hopper the paper uses 1e-5 (`lr_scale={'core': 1 / 30}`)."""
