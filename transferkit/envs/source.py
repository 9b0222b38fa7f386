"""A raw environment from any of its forms: in writing, a function, Gymnasium's, dm_control's."""

from __future__ import annotations

import importlib.util
import inspect
import math
import os
import sys
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import gymnasium

from transferkit.config.checks import Range, unfit
from transferkit.env_id import EnvId
from transferkit.envs.broken import failed
from transferkit.envs.names import name_of
from transferkit.envs.vary import Varied
from transferkit.envs.written import is_written
from transferkit.errors import ConfigError, EnvironmentContractError, TransferkitError, UnknownNameError, reason_of

if TYPE_CHECKING:
    from transferkit.envs.names import EnvLike

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


def is_maker(env: EnvLike) -> bool:
    """Whether it makes an environment whenever it is asked, in contrast to one that is made."""
    return not (isinstance(env, gymnasium.Env) or _is_native(env))


def raw_env(env: EnvLike, render_mode: str | None = None) -> gymnasium.Env:
    """Make an environment in any form, or take one that is made, without the contract."""
    if isinstance(env, str):
        return _from_id(env, render_mode)
    if isinstance(env, gymnasium.Env) or not callable(env):
        return _adapted(env)
    name = name_of(env)
    try:
        made = env()
    except TransferkitError:
        raise
    except (Exception, SystemExit) as error:  # of a function of the user's
        raise failed(name, "making it", error) from error
    return raw_env(made) if isinstance(made, str) else _adapted(made)


def id_from_file(env_id: str, source: str | Path, named: str | None = None, *, only: bool = False) -> str:
    """Take an environment that a file names; Gymnasium imports the module before a colon, which only the user may ask for.

    Args:
        env_id: what the file says.
        source: the file.
        named: what the user says.
        only: no other environment will do.

    Raises:
        EnvironmentContractError: it has a module and is not the one that the user named, or it is not in writing.
    """
    if only and named is not None and is_written(env_id) and named != env_id:
        raise EnvironmentContractError(f"{source} is of {env_id}, not of {named}", remedy=f"name that: {{env={env_id}}}")
    if not is_written(env_id):
        if named is None:
            raise EnvironmentContractError(
                f"the environment of {source} was {env_id}, which no id makes again",
                remedy="name one that does: {env=ID}, or {env=MODULE:FUNCTION}",
            )
        return named
    given = EnvId.read(env_id)
    if names_module(env_id) and (named is None or given.id != EnvId.read(named).id):
        raise EnvironmentContractError(
            f"{source} names the environment {env_id}, which runs the module {given.id.partition(':')[0]}",
            remedy=f"if you trust that, name it yourself: {{env={env_id}}}",
        )
    _check_repeats(given, MOST_REPEATS)
    return env_id


def _check_repeats(given: EnvId, most: float = math.inf) -> None:
    repeats = given.kwargs.get("frame_skip", 1)
    if unfit(repeats, Annotated[int, Range(1, most)]):
        allowed = "a whole number, at least 1" if math.isinf(most) else f"1 to {most}"
        raise EnvironmentContractError(f"frame_skip of {given.id}", value=repeats, allowed=allowed, topic="environments")


def names_module(env_id: str) -> bool:
    """Whether a module is imported to make an environment."""
    return ":" in EnvId.read(env_id).id


def _adapted(env: Any) -> gymnasium.Env:  # noqa: ANN401 - Gymnasium's, dm_control's, or something else
    """A Gymnasium environment of one that is Gymnasium's or dm_control's, as it is or in Shimmy's wrapper."""
    native = getattr(env, "_env", None) if type(env).__name__.startswith("DmControlCompatibility") else env
    if _is_native(native):
        import envs_dmc  # noqa: PLC0415 - takes seconds to import

        try:
            return envs_dmc.DmControlEnv(native, render_mode=getattr(env, "render_mode", None))
        except Exception as error:  # of somebody else's environment
            raise failed(type(native).__name__, "its specs", error) from error
    if not isinstance(env, gymnasium.Env):
        raise ConfigError(
            f"env is of type {type(env).__name__}",
            remedy="give an id, an environment of Gymnasium or dm_control, or a function that makes one",
            topic="environments",
        )
    return env


def _is_native(env: object) -> bool:
    """Whether it is dm_control's, which is only imported if somebody else has done so."""
    dm_env = sys.modules.get("dm_env")
    return dm_env is not None and isinstance(env, dm_env.Environment)


def _from_id(text: str, render_mode: str | None) -> gymnasium.Env:
    given = EnvId.read(text)
    if given.variation:
        plain = str(replace(given, variation={}))
        return Varied(_from_id(plain, render_mode), dict(given.variation), lambda: _from_id(plain, None))
    kwargs: dict[str, Any] = dict(given.kwargs) | ({} if render_mode is None else {"render_mode": render_mode})
    if "render_mode" in given.kwargs:  # a window without a display ends the process
        raise EnvironmentContractError(
            f"{text} sets render_mode", remedy="leave it out; `transferkit play` shows an environment"
        )
    _check_files(text, kwargs)
    _check_repeats(given)
    if given.id.startswith(DM_CONTROL_PREFIX):
        return _from_suite(text, given.id, kwargs)
    module, colon, name = given.id.partition(":")
    if colon and (":" in name or not all(part.isidentifier() for part in module.split("."))):
        raise EnvironmentContractError(
            f"environment {text}", allowed="an id, MODULE:ID or MODULE:FUNCTION", topic="environments"
        )
    _check_version(given.id)
    try:
        make = _function_in(module, name) if colon else None
        if make is not None:
            made = make(**kwargs) if _takes(make, kwargs) else make(**given.kwargs)
            return raw_env(made) if isinstance(made, str) else _adapted(made)
        return gymnasium.make(given.id, disable_env_checker=True, **kwargs)
    except (gymnasium.error.UnregisteredEnv, gymnasium.error.NameNotFound):
        if colon:
            raise UnknownNameError(f"id or function of module {module}", name, _names_in(module)) from None
        if given.id.endswith(".xml"):
            raise EnvironmentContractError(
                f"{given.id} is a model and not an environment",
                remedy="give it to one, such as 'Ant-v5?xml_file=FILE', or write a class around it (docs/own_environment.md)",
            ) from None
        raise UnknownNameError("environment", given.id, environment_ids(), topic="environments") from None
    except (gymnasium.error.Error, ModuleNotFoundError) as error:
        why = f"environment {text} cannot be made: {reason_of(error)}"
        raise EnvironmentContractError(why, topic="environments") from error
    except TransferkitError:
        raise
    except (Exception, SystemExit) as error:  # of a module or an environment of the user's
        raise failed(text, "making it", error) from error


def _check_version(name: str) -> None:
    """Refuse an id of several versions: which one Gymnasium makes of it is another when there is a newer."""
    versions = [known for known in gymnasium.registry if known.rpartition("-v")[0] == name]
    if versions and name not in gymnasium.registry:
        raise UnknownNameError("environment", name, versions, topic="environments")


def _function_in(module: str, name: str) -> Callable[..., Any] | None:
    """The function of this name in a module that the user named, which may lie in the working directory."""
    if importlib.util.find_spec(module.partition(".")[0]) is None and os.getcwd() not in sys.path:
        sys.path.append(os.getcwd())
    found = getattr(importlib.import_module(module), name, None) if name.isidentifier() else None
    return found if callable(found) else None


def _names_in(module: str) -> list[str]:
    """What a module offers: the ids that it registers, and its own functions."""
    own = vars(sys.modules[module])
    ids = [name for name, spec in gymnasium.registry.items() if str(spec.entry_point).startswith(module)]
    ids += [name for name, spec in gymnasium.registry.items() if getattr(spec.entry_point, "__module__", None) == module]
    kinds = [value for value in own.values() if inspect.isfunction(value) or inspect.isclass(value)]
    return ids + [value.__name__ for value in kinds if value.__module__ == module]


def _takes(make: Callable[..., Any], kwargs: dict[str, Any]) -> bool:
    """Whether a function takes these arguments; most know no `render_mode`."""
    try:
        inspect.signature(make).bind(**kwargs)
    except TypeError:
        return False
    return True


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
