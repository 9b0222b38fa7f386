"""The wrappers around an environment, whoever wrote them, and the spaces that it shows."""

from __future__ import annotations

import gymnasium
from gymnasium.spaces import Box, Dict
from gymnasium.wrappers import ClipAction

from transferkit.envs.broken import failed
from transferkit.errors import EnvironmentContractError


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


def check_spaces(env: gymnasium.Env, name: str) -> None:
    """Check that an environment's observations and actions are flat, and its actions bounded.

    Raises:
        EnvironmentContractError: they are not, or it fails to say.
    """
    try:
        spaces = (("action", bounds(env), True), ("observation", env.observation_space, False))
    except Exception as error:  # of an environment of the user's
        raise failed(name, "its spaces", error) from error
    for what, space, bounded in spaces:
        if not isinstance(space, Box) or len(space.shape) != 1 or not space.shape[0] or (bounded and not space.is_bounded()):
            raise EnvironmentContractError(
                f"{what} space of {name}",
                value=space,
                allowed=f"a flat{' and bounded' * bounded} Box",
                remedy="wrap it in gymnasium.wrappers.FlattenObservation" if isinstance(space, Dict) else "",
                topic="environments",
            )
