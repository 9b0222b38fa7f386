"""What a core of a family has met of its robot: to a body that was among it nothing is scaled."""

from __future__ import annotations

from typing import TYPE_CHECKING, NamedTuple

from transferkit.env_id import EnvId
from transferkit.errors import TransferkitError
from transferkit.variation import ONE, Variation

if TYPE_CHECKING:
    from transferkit.spec import IOSpec
    from transferkit.variation import Amount

ROUNDING = 1e-3
"""Relative: masses and lengths are measured."""


class Family(NamedTuple):
    """The least and the largest factors of a whole robot's lengths and mass that a core was trained on."""

    lengths: Amount = ONE
    masses: Amount = ONE

    def has(self, length: float, mass: float) -> bool:
        """Whether it was drawn so long and so heavy, as factors of the body that the core's spec describes."""
        return self != Family() and _within(length, self.lengths) and _within(mass, self.masses)


def family_of(source: IOSpec, target: IOSpec) -> Family:
    """Read it in the name of a core's environment; all factors are 1 of one body, for another robot, and if it is none.

    What is longer is heavier, too.
    """
    if source.model_names != target.model_names:
        return Family()
    try:
        variation = Variation.read(EnvId.read(source.env_id).variation)
    except TransferkitError:  # a stranger's name
        return Family()
    lengths, masses = (_relative(variation, name) for name in ("length", "mass"))
    return Family(lengths, (masses[0] * lengths[0], masses[1] * lengths[1]))


def _relative(variation: Variation, name: str) -> Amount:
    low, high = variation.factors.get(name, {}).get("", ONE)
    middle = variation.nominal().get(name, {}).get("", 1.0)
    return low / middle, high / middle


def _within(factor: float, amount: Amount) -> bool:
    return amount[0] * (1 - ROUNDING) <= factor <= amount[1] * (1 + ROUNDING)
