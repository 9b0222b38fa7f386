"""The wrappers around an environment, whoever wrote them."""

from __future__ import annotations

import gymnasium
from gymnasium.wrappers import ClipAction


def layers_of(env: gymnasium.Env) -> list[gymnasium.Env]:
    """An environment's wrappers from the outermost, and the environment itself."""
    layers = [env]
    while isinstance(layers[-1], gymnasium.Wrapper):
        layers.append(layers[-1].env)
    return layers


def bounds(env: gymnasium.Env) -> gymnasium.Space:
    """The space of an environment's actions; behind Gymnasium's `ClipAction`, which declares none, what it clips to."""
    layer = env
    while isinstance(layer, gymnasium.Wrapper) and layer.action_space == env.action_space:
        if isinstance(layer, ClipAction):
            return bounds(layer.env)
        layer = layer.env
    return env.action_space
