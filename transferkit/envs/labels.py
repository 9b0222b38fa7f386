"""Names for the elements of an observation from the environment's own description, for those whose meaning is not found."""

from __future__ import annotations

from collections import Counter
from collections.abc import Sequence
from typing import Any

import gymnasium


def labels(env: gymnasium.Env) -> list[str]:
    """A name per element, numbered where one word stands for several."""
    assert env.observation_space.shape is not None
    count = env.observation_space.shape[0]
    described = _described(env.unwrapped)
    return _numbered(described if len(described) == count else ["observation"] * count)


def unique(names: Sequence[str]) -> list[str]:
    """The names, numbered from the second of its kind: `hinge_y`, `hinge_y#2`."""
    seen: Counter[str] = Counter()
    result = []
    for name in names:
        seen[name] += 1
        result.append(name if seen[name] == 1 else f"{name}#{seen[name]}")
    return result


def _described(base: Any) -> list[str]:  # noqa: ANN401 - an environment of any kind
    if hasattr(base, "observation_keys"):
        return base.observation_keys()
    structure = getattr(base, "observation_structure", None) or {}
    return [name for name, count in structure.items() if not name.startswith("skipped") for _ in range(count)]


def _numbered(names: list[str]) -> list[str]:
    return [f"{name}[{names[:i].count(name)}]" for i, name in enumerate(names)]
