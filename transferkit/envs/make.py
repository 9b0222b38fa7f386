"""`make_env`: any supported environment under one contract.

One flat float32 observation, actions in [-1, 1] that are clipped and scaled to the actuator bounds, terminated and
truncated apart, `reset(seed=)` deterministic.
"""

from __future__ import annotations

import copy
import functools
import importlib
import os
import sys
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING, Any

import gymnasium
import numpy as np
from gymnasium.spaces import Box
from numpy.typing import NDArray

from transferkit.env_id import EnvId
from transferkit.envs.contract import Contract, dims, failed
from transferkit.envs.vary import Varied
from transferkit.envs.written import is_written, name_of, written
from transferkit.errors import EnvironmentContractError, TransferkitError, UnknownNameError
from transferkit.renderer import choose_renderer
from transferkit.variation import Variation

if TYPE_CHECKING:
    from transferkit.envs.written import EnvLike

Env = gymnasium.Env[NDArray[np.float32], NDArray[np.float32]]

DM_CONTROL_PREFIX = "dm_control/"

MOST_REPEATS = 1000
"""Physics steps of a control step that an id from a file may ask for."""


def environment_ids() -> list[str]:
    """Every environment that is tested by id: Gymnasium's MuJoCo v5 tasks and the dm_control suite."""
    import envs_dmc  # noqa: PLC0415 - takes seconds to import

    v5 = [
        env_id
        for env_id, spec in gymnasium.registry.items()
        if str(spec.entry_point).startswith("gymnasium.envs.mujoco") and spec.version == 5
    ]
    return sorted(v5) + sorted(envs_dmc.task_ids())


def make_env(
    env: EnvLike,
    *,
    render_mode: str | None = None,
    clip_actions: bool = True,
    max_episode_steps: int | None = None,
) -> Env:
    """Put an environment under transferkit's contract.

    Args:
        env: an id of Gymnasium's registry or `dm_control/<domain>-<task>-v0`, perhaps with keyword arguments
            (`Ant-v5?frame_skip=10`); an environment of your own, Gymnasium's or dm_control's; or a function that makes one.
        render_mode: handed to the environment when it is made from an id.
        clip_actions: False lets actions beyond [-1, 1] reach the environment, as in the paper's code.
        max_episode_steps: truncate episodes here; by default after 10,000 steps if the environment has no limit of its own.

    Raises:
        UnknownNameError: no environment has this id.
        EnvironmentContractError: a discrete, image or nested space, actions without bounds or without room between them, or
            nothing can be rendered here.
    """
    if render_mode is not None:
        choose_renderer()
    raw = _raw(env, render_mode)
    if isinstance(raw, Contract):
        if (clip_actions or not raw.clip) and max_episode_steps is None:
            return raw
        raw, clip_actions = raw.env, clip_actions and raw.clip
    name = name_of(env if isinstance(env, str) else raw)
    try:
        spaces = (("action", raw.action_space, True), ("observation", raw.observation_space, False))
    except Exception as error:  # of an environment of the user's
        raise failed(name, "its spaces", error) from error
    for what, space, bounded in spaces:
        if not isinstance(space, Box) or len(space.shape) != 1 or not space.shape[0] or (bounded and not space.is_bounded()):
            raise EnvironmentContractError(
                f"{what} space of {name}",
                value=space,
                allowed=f"a flat{' and bounded' * bounded} Box",
                topic="environments",
            )
    _check_room(raw.action_space, name)
    return Contract(raw, clip=clip_actions, max_episode_steps=max_episode_steps)


def vary(env: EnvLike, **changes: Any) -> gymnasium.Env:  # noqa: ANN401 - numbers, ranges, tables, lists
    """Make the same robot changed: in its model, by editing what it is compiled from, in what it observes, or in its actions.

    Factors multiply what the model has: one number, or a range `(low, high)` that is drawn anew in every episode, for all
    parts or as a table by name.

    Args:
        env: in any form that `make_env` takes; of one that is made the model is changed in place.
        **changes: `mass` and `length` (by body), `gear` (by actuator or its joint), `damping` (by joint), `friction` (sliding,
            by geom), `gravity`: factors. `delay`: control steps by which actions come late. `noise`: standard deviation on
            the observation, in its units, for all elements or by name. `drop_observation`: names or indices of elements that
            it then lacks. `dead_actuator`: names or indices of actuators without force.

    Raises:
        UnknownNameError: nothing of this name can be varied, or the model has no such part.
        ConfigError: a value that it cannot have, or a change that cannot be made on this model.
    """
    variation = Variation.read(changes).written()
    if isinstance(env, str):
        given = EnvId.read(env)
        return _from_id(str(replace(given, variation={**given.variation, **variation})), None)
    raw = _raw(env, None)
    raw = raw.env if isinstance(raw, Contract) else raw
    again = (lambda: _raw(env, None)) if is_maker(env) else None
    return Varied(raw, variation, again)


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
        name = written(made.env) if isinstance(made, Contract) else written(made)
        if not is_written(name):
            return name
        with opened(name) as again:
            made.reset(seed=0)
            again.reset(seed=0)  # which changes the models of some
            return name if _same_model(made, again) else f"<{name}, changed>"


def dims_of(env: EnvLike) -> tuple[int, int]:
    """As `dims`, of an environment in any form."""
    with opened(env) as made:
        return dims(made)


@contextmanager
def opened(env: EnvLike, **rules: Any) -> Iterator[Env]:  # noqa: ANN401 - those of `make_env`
    """An environment under the contract, which is closed afterwards if it was made here."""
    made = make_env(env, **rules)
    try:
        yield made
    finally:
        if is_maker(env):
            made.close()


def is_maker(env: EnvLike) -> bool:
    """Whether it makes an environment whenever it is asked, in contrast to one that is made."""
    return not (isinstance(env, gymnasium.Env) or _is_native(env))


def id_from_file(env_id: str, source: str | Path, named: str | None = None) -> str:
    """Take an environment that a file names; Gymnasium imports the module before a colon, which only the user may ask for.

    Raises:
        EnvironmentContractError: it has a module and is not the one that the user named, or it is not in writing.
    """
    if not is_written(env_id):
        if named is None:
            raise EnvironmentContractError(
                f"the environment of {source} was {env_id}, which no id makes again",
                remedy="name one that does: {env=ID}, or {env=MODULE:FUNCTION}",
            )
        return named
    given = EnvId.read(env_id)
    if ":" in given.id and (named is None or given.id != EnvId.read(named).id):
        raise EnvironmentContractError(
            f"{source} names the environment {env_id}, which runs the module {given.id.partition(':')[0]}",
            remedy=f"if you trust that, name it yourself: {{env={env_id}}}",
        )
    repeats = given.kwargs.get("frame_skip", 1)
    if not isinstance(repeats, int) or not 1 <= repeats <= MOST_REPEATS:
        raise EnvironmentContractError(f"frame_skip of {env_id}", value=repeats, allowed=f"1 to {MOST_REPEATS}")
    return env_id


def _raw(env: EnvLike, render_mode: str | None) -> gymnasium.Env:
    if isinstance(env, str):
        return _from_id(env, render_mode)
    if isinstance(env, gymnasium.Env):
        return _adapted(env)
    if not callable(env):
        return _adapted(env)
    name = name_of(env)
    try:
        made = env()
    except TransferkitError:
        raise
    except (Exception, SystemExit) as error:  # of a function of the user's
        raise failed(name, "making it", error) from error
    return make_env(made).env if isinstance(made, str) else _adapted(made)  # pyright: ignore[reportAttributeAccessIssue]


def _adapted(env: Any) -> gymnasium.Env:  # noqa: ANN401 - Gymnasium's, dm_control's, or something else
    """A Gymnasium environment of one that is Gymnasium's or dm_control's, as it is or in Shimmy's wrapper."""
    native = getattr(env, "_env", None) if type(env).__name__.startswith("DmControlCompatibility") else env
    if _is_native(native):
        import envs_dmc  # noqa: PLC0415 - takes seconds to import

        return envs_dmc.DmControlEnv(native, render_mode=getattr(env, "render_mode", None))
    if not isinstance(env, gymnasium.Env):
        raise EnvironmentContractError(
            f"env is of type {type(env).__name__}",
            remedy="give an id, an environment of Gymnasium or dm_control, or a function that makes one",
            topic="environments",
        )
    return env


def _is_native(env: object) -> bool:
    """Whether it is dm_control's, which is only imported if somebody else has done so."""
    dm_env = sys.modules.get("dm_env")
    return dm_env is not None and isinstance(env, dm_env.Environment)


def _copied(env: gymnasium.Env) -> gymnasium.Env:
    try:
        return copy.deepcopy(env)
    except Exception as error:  # whatever an attribute of the user's raises
        raise EnvironmentContractError(
            f"environment {name_of(env)} cannot be copied: {type(error).__name__}: {error}",
            remedy="give a function that makes one",
            topic="environments",
        ) from None


def _same_model(env: gymnasium.Env, other: gymnasium.Env) -> bool:
    from transferkit.envs.simulation import model_bytes  # noqa: PLC0415 - mujoco takes a moment

    return model_bytes(env) == model_bytes(other)


def _check_room(space: gymnasium.Space, name: str) -> None:
    assert isinstance(space, Box)
    for k in np.flatnonzero(space.low >= space.high):
        raise EnvironmentContractError(
            f"action {k} of {name} has bounds {space.low[k]:g} to {space.high[k]:g} and cannot do anything",
            remedy="give its actuator a ctrlrange in the model",
            topic="environments",
        )


def _from_id(text: str, render_mode: str | None) -> gymnasium.Env:
    given = EnvId.read(text)
    if given.variation:
        plain = str(replace(given, variation={}))
        return Varied(_from_id(plain, render_mode), dict(given.variation), lambda: _from_id(plain, None))
    kwargs: dict[str, Any] = dict(given.kwargs) | ({} if render_mode is None else {"render_mode": render_mode})
    _check_files(text, kwargs)
    if given.id.startswith(DM_CONTROL_PREFIX):
        return _from_suite(text, given.id, kwargs)
    module, colon, name = given.id.partition(":")
    if colon and (":" in name or not all(part.isidentifier() for part in module.split("."))):
        raise EnvironmentContractError(
            f"environment {text}", allowed="an id, MODULE:ID or MODULE:FUNCTION", topic="environments"
        )
    try:
        make = _function_in(module, name) if colon else None
        if make is not None:
            return _adapted(make(**kwargs))
        return gymnasium.make(given.id, disable_env_checker=True, **kwargs)
    except (gymnasium.error.UnregisteredEnv, gymnasium.error.NameNotFound):
        raise UnknownNameError("environment", given.id, environment_ids(), topic="environments") from None
    except (gymnasium.error.Error, ModuleNotFoundError) as error:
        reason = (str(error).splitlines() or [type(error).__name__])[0]
        raise EnvironmentContractError(f"environment {text} cannot be made: {reason}", topic="environments") from error
    except TransferkitError:
        raise
    except (Exception, SystemExit) as error:  # of a module or an environment of the user's
        raise failed(text, "making it", error) from error


def _function_in(module: str, name: str) -> Callable[..., Any] | None:
    """The function of this name in a module that the user named, which may lie in the working directory."""
    if os.getcwd() not in sys.path:
        sys.path.append(os.getcwd())
    found = getattr(importlib.import_module(module), name, None) if name.isidentifier() else None
    return found if callable(found) else None


def _check_files(text: str, kwargs: dict[str, Any]) -> None:
    """Refuse pipes and devices, which an id from a file may name where a model is expected."""
    for name, value in kwargs.items():
        if isinstance(value, str) and os.path.exists(value) and not os.path.isfile(value):
            raise EnvironmentContractError(f"{name} of {text}", value=value, allowed="a regular file", topic="environments")


def _from_suite(text: str, env_id: str, kwargs: dict[str, Any]) -> gymnasium.Env:
    import envs_dmc  # noqa: PLC0415 - takes seconds to import

    if env_id not in envs_dmc.task_ids():
        raise UnknownNameError("environment", env_id, environment_ids(), topic="environments")
    try:
        return envs_dmc.make(env_id, **kwargs)
    except (TypeError, ValueError) as error:
        raise failed(text, "making it", error) from error
