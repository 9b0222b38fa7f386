"""`make_env`: any supported environment under one contract.

One flat float32 observation, actions in [-1, 1] that are clipped and scaled to the actuator bounds, terminated and
truncated apart, `reset(seed=)` deterministic.
"""

from __future__ import annotations

import copy
import functools
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import replace
from typing import TYPE_CHECKING, Annotated, Any

import gymnasium
import numpy as np
from gymnasium.spaces import Box
from numpy.typing import NDArray

from transferkit.config.checks import AT_LEAST_ONE, check_value
from transferkit.env_id import EnvId
from transferkit.envs.broken import failed
from transferkit.envs.contract import Contract, dims, time_step
from transferkit.envs.layers import bounds, check_spaces, layers_of
from transferkit.envs.names import name_of
from transferkit.envs.simulation import model_bytes
from transferkit.envs.source import is_maker, raw_env
from transferkit.envs.vary import Varied
from transferkit.envs.written import is_written, written
from transferkit.errors import EnvironmentContractError, TransferkitError
from transferkit.renderer import choose_renderer
from transferkit.variation import Variation

if TYPE_CHECKING:
    from transferkit.envs.names import EnvLike

Env = gymnasium.Env[NDArray[np.float32], NDArray[np.float32]]


def make_env(
    env: EnvLike,
    *,
    render_mode: str | None = None,
    clip_actions: bool = True,
    max_episode_steps: int | None = None,
) -> Contract:
    """Put an environment under transferkit's contract.

    Args:
        env: an id of Gymnasium's registry or `dm_control/<domain>-<task>-v0`, perhaps with keyword arguments
            (`Ant-v5?frame_skip=10`); an environment of your own, Gymnasium's or dm_control's; or a function that makes one.
        render_mode: handed to the environment when it is made from an id.
        clip_actions: False lets actions beyond [-1, 1] reach the environment, as in the paper's code.
        max_episode_steps: truncate episodes here; by default after 10,000 steps if the environment has no limit of its own.

    Raises:
        UnknownNameError: no environment has this id.
        SettingError: `max_episode_steps` is below 1.
        EnvironmentContractError: a discrete, image or nested space, actions without bounds or without room between them, or
            nothing can be rendered here.
    """
    if render_mode is not None:
        choose_renderer()
    raw = raw_env(env, render_mode)
    if isinstance(raw, Contract):
        if (clip_actions or not raw.clip) and max_episode_steps is None:
            return raw
        max_episode_steps = raw.max_episode_steps if max_episode_steps is None else max_episode_steps
        raw, clip_actions = raw.env, clip_actions and raw.clip
    name = name_of(env if isinstance(env, str) else raw)
    check_spaces(raw, name)
    _check_room(bounds(raw), name)
    if max_episode_steps is not None:
        check_value("max_episode_steps", max_episode_steps, Annotated[int, AT_LEAST_ONE])
    try:
        return Contract(raw, clip=clip_actions, max_episode_steps=max_episode_steps)
    except TransferkitError:
        raise
    except Exception as error:  # of an environment of the user's
        raise failed(name, "what it says of itself", error) from error


def vary(env: EnvLike, **changes: Any) -> gymnasium.Env:  # noqa: ANN401 - numbers, ranges, tables, lists
    """Make the same robot changed: in its model, by editing what it is compiled from, in what it observes, or in its actions.

    Factors multiply what the model has: one number, or a range `(low, high)` that is drawn anew in every episode, for all
    parts or as a table by name.

    Args:
        env: in any form that `make_env` takes; of one that is made the model is changed in place.
        **changes: `mass` and `length` (by body), `gear` (by actuator or its joint), `damping` (by joint), `friction` (sliding,
            by geom), `gravity`: factors. `control_step`: a factor, too, in whole physics steps. `delay`: control steps by
            which actions come late. `noise`: standard deviation on the observation, in its units, for all elements or by name.
            `permute_observation`: names or indices of elements that change places. `drop_observation`: of those that it then
            lacks. `frames`: how many of the latest observations are one, the oldest first. `dead_actuator`: names or indices
            of actuators without force.

    Raises:
        UnknownNameError: nothing of this name can be varied, or the model has no such part.
        ConfigError: a value that it cannot have, or a change that cannot be made on this model.
    """
    if isinstance(env, str):
        given = EnvId.read(env)
        return raw_env(str(replace(given, variation=Variation.read(given.variation).with_more(changes).written())))
    raw = raw_env(env)
    if isinstance(raw, Contract):
        return Contract(_varied(env, raw.env, changes), clip=raw.clip, max_episode_steps=raw.max_episode_steps)
    return _varied(env, raw, changes)


def _varied(env: EnvLike, raw: gymnasium.Env, changes: dict[str, Any]) -> Varied:
    if isinstance(raw, Varied):
        return raw.with_more(changes)
    return Varied(raw, Variation.read(changes).written(), (lambda: raw_env(env)) if is_maker(env) else None)


def copies_of(env: EnvLike) -> str | Callable[[], gymnasium.Env]:
    """What makes an environment as often as needed: of one that is made, copies.

    Raises:
        ConfigError: it is no environment, or cannot be copied.
    """
    if is_maker(env):
        return env  # pyright: ignore[reportReturnType] - an id or a function
    return functools.partial(_copied, env)  # pyright: ignore[reportArgumentType]


def recorded(env: EnvLike) -> str:
    """What a record says of an environment: what makes it again, or `<its name>` if nothing in writing does.

    A model that was changed after it was made is not made again by its id.
    """
    if isinstance(env, str):
        return env
    with opened(env) as made:
        name = written(made.env)
        if not is_written(name):
            return name
        with opened(name) as again:
            made.reset(seed=0)
            again.reset(seed=0)  # which changes the models of some
            return name if _same_model(made, again) else f"<{name}, changed>"


def rules_of(env: EnvLike) -> dict[str, Any]:
    """The rules of `make_env` under which an environment was made that are not its defaults."""
    if isinstance(env, str):
        return {}
    with opened(env) as made:
        rules = {"clip_actions": (made.clip, True), "max_episode_steps": (made.max_episode_steps, None)}
    return {name: value for name, (value, usual) in rules.items() if value != usual}


def dims_of(env: EnvLike) -> tuple[int, int]:
    """As `dims`, of an environment in any form."""
    with opened(env) as made:
        return dims(made)


@contextmanager
def opened(env: EnvLike, **rules: Any) -> Iterator[Contract]:  # noqa: ANN401 - those of `make_env`
    """An environment under the contract, which is closed afterwards if it was made here."""
    made = make_env(env, **rules)
    try:
        yield made
    finally:
        if is_maker(env):
            made.close()


def _copied(env: gymnasium.Env) -> gymnasium.Env:
    """Copy an environment as it is now; Gymnasium's own way makes it again from the arguments that it was made with."""
    layers = layers_of(env)
    twins: list[Any] = [object.__new__(type(one)) for one in layers]
    memo: dict[int, Any] = {id(one): twin for one, twin in zip(layers, twins, strict=True)}
    try:
        for one, twin in reversed([*zip(layers, twins, strict=True)]):
            vars(twin).update({name: copy.deepcopy(value, memo) for name, value in vars(one).items()})
    except Exception as error:  # whatever an attribute of the user's raises
        raise EnvironmentContractError(
            f"environment {name_of(env)} cannot be copied: {type(error).__name__}: {error}",
            remedy="give a function that makes one",
            topic="own environments",
        ) from None
    return twins[0]


def _same_model(env: gymnasium.Env, other: gymnasium.Env) -> bool:
    """Whether the models are the same, and the physics steps of a control step."""
    paces = [(time_step(one), getattr(one.unwrapped, "frame_skip", None)) for one in (env, other)]
    return paces[0] == paces[1] and model_bytes(env) == model_bytes(other)


def _check_room(space: gymnasium.Space, name: str) -> None:
    assert isinstance(space, Box)
    with np.errstate(over="ignore"):
        room = space.high.astype(float) - space.low.astype(float)
    for k in np.flatnonzero(np.isnan(room)):
        raise EnvironmentContractError(
            f"action {k} of {name} has bounds {space.low[k]:g} to {space.high[k]:g}", topic="own environments"
        )
    for k in np.flatnonzero(np.isinf(room)):
        raise EnvironmentContractError(
            f"action {k} of {name} has bounds {space.low[k]:g} to {space.high[k]:g}, too far apart", topic="own environments"
        )
    for k in np.flatnonzero(room <= 0):
        raise EnvironmentContractError(
            f"action {k} of {name} has bounds {space.low[k]:g} to {space.high[k]:g} and cannot do anything",
            remedy="give its actuator a ctrlrange in the model",
            topic="own environments",
        )
