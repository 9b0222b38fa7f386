"""What the settings are chosen by."""

from __future__ import annotations

import functools
from typing import Any, Literal, get_args, get_origin, get_type_hints

from transferkit.errors import ConfigError, did_you_mean

Algorithm = Literal["ppo", "dyna-ddpg", "dyna-ppo"]
Preset = Literal["default", "paper"]


def check_choices(config: object) -> None:
    """Check every field of a configuration that takes one of a few names.

    Raises:
        ConfigError: one has another.
    """
    for name, known in _choices(type(config)).items():
        value = getattr(config, name)
        if value not in known:
            raise ConfigError(f"{name}={value!r} is unknown; {did_you_mean(str(value), known)}it takes {' or '.join(known)}")


@functools.cache
def _choices(kind: type) -> dict[str, tuple[Any, ...]]:
    return {name: get_args(hint) for name, hint in get_type_hints(kind).items() if get_origin(hint) is Literal}
