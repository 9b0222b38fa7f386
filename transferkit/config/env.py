"""Settings of the environment."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Annotated

from transferkit.config.checks import AT_LEAST_ONE, check


@dataclass(frozen=True)
class EnvConfig:
    """How a policy meets its environment."""

    clip_actions: bool = True
    """Clip actions to [-1, 1] before the environment sees them; the paper does not."""
    max_episode_steps: Annotated[int, AT_LEAST_ONE] | None = None
    """Truncate episodes here; None leaves it to the environment, or truncates after 10,000 steps if it has no limit."""

    def __post_init__(self) -> None:
        check(self, "env_config")
