"""What an environment is called in messages."""

from __future__ import annotations

from collections.abc import Callable

import gymnasium

EnvLike = str | gymnasium.Env | Callable[[], gymnasium.Env]
"""An environment in any of its forms: in writing, made, or a function that makes one; of dm_control's kind too."""


def name_of(env: EnvLike) -> str:
    """The id of an environment as it was typed, or the name of its class if it has none."""
    if isinstance(env, str):
        return env
    if not isinstance(env, gymnasium.Env):
        return getattr(env, "__name__", type(env).__name__)
    try:
        return env.spec.id if env.spec is not None else type(env.unwrapped).__name__
    except Exception:  # of an environment of the user's; what needs more of it says what is wrong
        return type(env).__name__
