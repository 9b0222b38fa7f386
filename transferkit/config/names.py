"""What the settings are chosen by."""

from __future__ import annotations

import functools
from typing import Any, Literal, get_args, get_origin, get_type_hints

from transferkit.errors import ConfigError, did_you_mean

Algorithm = Literal["ppo", "dyna-ddpg", "dyna-ppo"]
Preset = Literal["default", "paper"]


def check_choices(config: object) -> None:
    """Check every field of a configuration that takes one of a few names, and the widths of hidden layers.

    Raises:
        ConfigError: one has another.
    """
    if any(type(width) is not int or width < 1 for width in getattr(config, "hidden", ())):
        raise ConfigError(f"hidden={config.hidden} must be whole numbers from 1, as 64 64")  # type: ignore[attr-defined]
    for name, known in _choices(type(config)).items():
        value = getattr(config, name)
        if value not in known:
            raise ConfigError(f"{name}={value!r} is unknown; {did_you_mean(str(value), known)}it takes {' or '.join(known)}")


@functools.cache
def _choices(kind: type) -> dict[str, tuple[Any, ...]]:
    return {name: get_args(hint) for name, hint in get_type_hints(kind).items() if get_origin(hint) is Literal}
