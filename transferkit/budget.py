"""The experience that a training run may spend, and what it has spent."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import asdict, dataclass, fields
from typing import Annotated, Any

from transferkit.config.checks import AT_LEAST_ONE, POSITIVE, check
from transferkit.errors import ConfigError


@dataclass(frozen=True)
class Budget:
    """An upper bound on experience; the first limit reached ends training.

    Raises:
        ConfigError: no limit is given, or one is not positive.
    """

    episodes: Annotated[int, AT_LEAST_ONE] | None = None
    """Completed episodes, over all parallel environments together."""
    steps: Annotated[int, AT_LEAST_ONE] | None = None
    """Environment steps, over all parallel environments together."""
    seconds: Annotated[float, POSITIVE] | None = None
    """Wall-clock seconds of training, evaluation not counted."""

    def __post_init__(self) -> None:
        check(self)
        if (self.episodes, self.steps, self.seconds) == (None, None, None):
            raise ConfigError("no budget given", remedy="give {episodes}, {steps} or {seconds}")

    def without(self, spent: Spent) -> Budget:
        """Take off what is spent; of each kind the smallest budget is left at least."""
        left = {kind: max(limit - getattr(spent, kind), LEAST[kind]) for kind, limit in self.limits().items()}
        return Budget(**left)  # pyright: ignore[reportArgumentType] - whole where they are

    def limits(self) -> dict[str, float]:
        """Return the limits that are given, by kind."""
        return given_limits(asdict(self))


KINDS = tuple(field.name for field in fields(Budget))
"""Names of the limits."""


LEAST = {"episodes": 1, "steps": 1, "seconds": 1e-9}
"""The smallest budget of each kind."""


def given_limits(data: Mapping[str, Any]) -> dict[str, float]:
    """Pick the limits that are given out of a configuration."""
    return {kind: data[kind] for kind in KINDS if data.get(kind) is not None}


@dataclass
class Spent:
    """Experience used so far; the same three units as `Budget`."""

    episodes: int = 0
    steps: int = 0
    seconds: float = 0.0

    def exhausts(self, budget: Budget) -> bool:
        """Decide whether any limit of the budget is reached."""
        return (
            (budget.steps is not None and self.steps >= budget.steps)
            or (budget.episodes is not None and self.episodes >= budget.episodes)
            or (budget.seconds is not None and self.seconds >= budget.seconds)
        )

    def since(self, before: Spent) -> Spent:
        """Take off what was spent before."""
        return Spent(self.episodes - before.episodes, self.steps - before.steps, self.seconds - before.seconds)

    def fraction(self, budget: Budget) -> float:
        """Return the largest used share of any limit, so that 1.0 ends training."""
        shares = [
            spent / limit
            for spent, limit in (
                (self.episodes, budget.episodes),
                (self.steps, budget.steps),
                (self.seconds, budget.seconds),
            )
            if limit is not None
        ]
        return max(shares)

    def step_fraction(self, budget: Budget) -> float:
        """Return the used share of the steps; if they have no limit, of the budget."""
        return self.fraction(budget) if budget.steps is None else self.steps / budget.steps
