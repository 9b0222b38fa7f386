"""What an environment is called in records: its id with its keyword arguments, if that makes it again."""

from __future__ import annotations

import json
from dataclasses import replace
from typing import Any

import gymnasium
import numpy as np
from gymnasium import wrappers
from gymnasium.envs.registration import EnvSpec

from transferkit.env_id import EnvId
from transferkit.envs.layers import layers_of
from transferkit.envs.names import name_of
from transferkit.envs.vary import Varied

SUITE = "envs_dmc.suite:SuiteTask"
"""Entry point of dm_control's tasks."""

BY_MAKE = (wrappers.OrderEnforcing, wrappers.PassiveEnvChecker, wrappers.TimeLimit)
"""Wrappers that `gymnasium.make` adds by itself."""


def is_written(env: str) -> bool:
    """Whether a name in a record makes the environment again."""
    return not env.startswith("<")


def written(env: gymnasium.Env) -> str:
    """What a record says of an environment: an id with keyword arguments that makes it again, or `<its name>`."""
    if isinstance(env, Varied):
        plain = written(env.env)
        varied = EnvId.read(plain) if is_written(plain) else None
        return f"<Varied of {name_of(env)}>" if varied is None else str(replace(varied, variation=env.variation.written()))
    spec, own = env.spec, type(env).__name__
    name = (
        f"<{type(env.unwrapped).__name__}>"
        if env is env.unwrapped or isinstance(env, BY_MAKE)
        else f"<{own} of {name_of(env)}>"
    )
    if spec is None or not _bare(env):
        return name
    kwargs = _arguments(spec)
    if kwargs is None:
        return name
    try:
        return str(EnvId(spec.id, json.loads(json.dumps(kwargs, default=_plain, allow_nan=False))))
    except (TypeError, ValueError):
        return name


def _arguments(spec: EnvSpec) -> dict[str, Any] | None:
    """The keyword arguments that are given beside an id to make the environment again; None if the id is another's."""
    given = {key: value for key, value in spec.kwargs.items() if key != "render_mode"}
    if spec.entry_point == SUITE:
        return {key: value for key, value in given.items() if key not in ("domain", "task")}
    registered = gymnasium.registry.get(spec.id)
    if registered is None or registered.entry_point != spec.entry_point:
        return None
    given = {key: value for key, value in given.items() if registered.kwargs.get(key) != value}
    limit = {"max_episode_steps": spec.max_episode_steps or -1}
    return given | (limit if spec.max_episode_steps != registered.max_episode_steps else {})


def _bare(env: gymnasium.Env) -> bool:
    """Whether nobody but `gymnasium.make` has wrapped it, which limits its episodes once."""
    kinds = [type(layer) for layer in layers_of(env)[:-1]]
    return set(kinds) <= {*BY_MAKE} and kinds.count(wrappers.TimeLimit) <= 1


def _plain(value: Any) -> object:  # noqa: ANN401 - what json cannot write
    if isinstance(value, np.ndarray | np.generic):
        return value.tolist()
    raise TypeError
