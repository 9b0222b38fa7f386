"""Settings of the environment."""

from __future__ import annotations

from dataclasses import dataclass

from transferkit.config.checks import check


@dataclass(frozen=True)
class EnvConfig:
    """How a policy meets its environment."""

    clip_actions: bool = True
    """Clip actions to [-1, 1] before the environment sees them; the paper does not."""

    def __post_init__(self) -> None:
        check(self, "env_config")
