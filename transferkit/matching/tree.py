"""Kinematic trees of joints, in an order that does not depend on who wrote the model.

Slides and hinges of one body that commute may be listed in any order and move it alike: here the order is that of their axes.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING

import numpy as np

if TYPE_CHECKING:
    from transferkit.spec import Joint

PARALLEL = 0.99
"""Least cosine between axes that count as the same."""

Tree = dict[str | None, tuple[str, ...]]
"""The joints that hang on each one, None for the world."""


def kinematic_tree(joints: Sequence[Joint]) -> Tree:
    """Collect which joints hang on which, with commuting joints of one body in the order of their axes."""
    by_name = {joint.name: joint for joint in joints}
    parents = {joint.name: joint.parent for joint in joints}
    while swap := next((name for name in by_name if _out_of_order(name, parents, by_name)), None):
        _exchange(parents, upper=str(parents[swap]), lower=swap)
    names: list[str | None] = [None, *by_name]
    return {name: tuple(child for child in by_name if parents[child] == name) for name in names}


def parallel(one: Joint, other: Joint) -> bool:
    """Whether two joints have one axis, either way."""
    return abs(float(np.dot(one.axis, other.axis))) >= PARALLEL


def below(tree: Tree, name: str) -> list[str]:
    """List a joint and everything that hangs on it."""
    return [name, *(each for child in tree[name] for each in below(tree, child))]


def _out_of_order(name: str, parents: dict[str, str | None], by_name: dict[str, Joint]) -> bool:
    """Whether a joint hangs on one that it commutes with and that should come after it."""
    parent = parents[name]
    if parent is None:
        return False
    joint, upper = by_name[name], by_name[parent]
    return bool(joint.body) and joint.body == upper.body and _commute(joint, upper) and _rank(joint) < _rank(upper)


def _commute(one: Joint, other: Joint) -> bool:
    return one.type == other.type == "slide" or parallel(one, other)


def _rank(joint: Joint) -> tuple[int, bool]:
    return int(np.argmax(np.abs(joint.axis))), joint.type == "hinge"


def _exchange(parents: dict[str, str | None], *, upper: str, lower: str) -> None:
    """Let the lower joint carry the upper one, which takes over what it carried."""
    for name, parent in parents.items():
        if parent == lower:
            parents[name] = upper
    parents[lower], parents[upper] = parents[upper], lower
