"""The MuJoCo model, data and observation function behind an environment of either backend."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import gymnasium
import numpy as np
from numpy.typing import NDArray

if TYPE_CHECKING:
    from transferkit.physics import mujoco


@dataclass(frozen=True)
class Simulation:
    """One environment opened for probing."""

    backend: str
    model: mujoco.MjModel
    data: mujoco.MjData
    observe: Callable[[], NDArray[np.floating]] | None
    """Returns the observation `(obs_dim,)` of the present state; None if the environment offers no way to ask for it."""
    labels: list[str]
    """A fallback name per element, from the backend's own description."""


def open_simulation(env: gymnasium.Env) -> Simulation | None:
    """Open the simulation behind an environment; None if it is not MuJoCo."""
    base: Any = env.unwrapped
    if hasattr(base, "physics") and hasattr(base, "get_observation"):
        physics = base.physics
        labels = _numbered(base.observation_keys())
        return Simulation("dm_control", physics.model.ptr, physics.data.ptr, base.get_observation, labels)
    model, data = getattr(base, "model", None), getattr(base, "data", None)
    if model is None or data is None or not hasattr(model, "nq"):
        return None
    raw = getattr(base, "_get_obs", None)
    observe = None if raw is None else lambda: _through_wrappers(env, raw())
    assert env.observation_space.shape is not None
    return Simulation("gymnasium", model, data, observe, _gymnasium_labels(base, env.observation_space.shape[0]))


def _through_wrappers(env: gymnasium.Env, observation: NDArray[np.floating]) -> NDArray[np.floating]:
    """What the environment's wrappers make of an observation of the innermost one."""
    wrappers = []
    while isinstance(env, gymnasium.Wrapper):
        wrappers.append(env)
        env = env.env
    for wrapper in reversed(wrappers):
        if isinstance(wrapper, gymnasium.ObservationWrapper):
            observation = wrapper.observation(observation)
    return observation


def _gymnasium_labels(base: gymnasium.Env, obs_dim: int) -> list[str]:
    structure = getattr(base, "observation_structure", None) or {}
    names = [name for name, count in structure.items() if not name.startswith("skipped") for _ in range(count)]
    return _numbered(names if len(names) == obs_dim else ["observation"] * obs_dim)


def _numbered(names: list[str]) -> list[str]:
    return [f"{name}[{names[:i].count(name)}]" for i, name in enumerate(names)]
