"""Which number of a target is a core's input that has no form: what no combination of others gives, but the same robot has."""

from __future__ import annotations

from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from transferkit.spec import Element, IOSpec

FORMLESS = ("height", "function of position", "function of velocity", "force", "time", "constant", "unknown")
"""Quantities that no combination of others gives."""

SAME = 1e-3
"""Difference of two values, as a share of the largest, up to which they count as one."""


def counterpart(element: Element, source: IOSpec, target: IOSpec) -> int | None:
    """Find the place of an element in the same mechanism: where the values are the same, or else the name is.

    What has the values of another of the core's inputs is not taken by its name.
    """
    named = [k for k, other in enumerate(target.observation) if _alike(element, other)]
    equal = [k for k, other in enumerate(target.observation) if same_values(element, other)]
    if equal:
        return next((k for k in named if k in equal), equal[0])
    return next((k for k in named if not any(same_values(own, target.observation[k]) for own in source.observation)), None)


def _alike(element: Element, other: Element) -> bool:
    """Whether two elements have one name; what they respond to is found with random states and may differ."""
    return all(getattr(element, name) == getattr(other, name) for name in ("name", "quantity", "unit", "age"))


def same_values(element: Element, other: Element) -> bool:
    """Whether two elements say the same in the same states."""
    if not element.values or not other.values or (element.quantity, element.age) != (other.quantity, other.age):
        return False
    apart = max(abs(own - another) for own, another in zip(element.values, other.values, strict=False))
    return apart <= SAME * max(map(abs, element.values)) + element.doubt + other.doubt
