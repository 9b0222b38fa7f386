"""The MuJoCo model and data behind an environment, whoever wrote it."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from typing import Any

import gymnasium
import numpy as np

from transferkit.physics import mujoco

DEPTH = 3
"""How far below an environment its model and data are looked for: `env.robot.physics.data`."""


COUNTERS = ("frame_skip", "_n_sub_steps")
"""Attributes of Gymnasium's and dm_control's environments that hold how many physics steps a control step has."""

FEW = 16
"""Items of a tuple, list or dictionary that are looked at."""


@dataclass(frozen=True)
class Simulation:
    """A simulation; some environments make a new model and new data in every reset, so both are asked for when needed."""

    owner: Any
    """Has the model and the data as attributes, or dm_control's `physics`."""

    @property
    def backend(self) -> str:
        """`dm_control`, or `gymnasium` for everything else."""
        return "dm_control" if _is_physics(getattr(self.owner, "physics", None)) else "gymnasium"

    @property
    def keepers(self) -> list[Any]:
        """The owner and what it is made of: one of them counts the steps."""
        physics = [self.owner.physics] if self.backend == "dm_control" else []
        return [self.owner, *_parts(self.owner), *physics]

    @property
    def counters(self) -> list[tuple[Any, str]]:
        """What holds the number of physics steps of a control step, and under what name."""
        return [(keeper, name) for keeper in self.keepers for name in COUNTERS if counts(keeper, name)]

    @property
    def model(self) -> mujoco.MjModel:
        """The model as it is now."""
        return _pair(self.owner)[0]

    @property
    def data(self) -> mujoco.MjData:
        """The data as they are now."""
        return _pair(self.owner)[1]


def open_simulation(env: gymnasium.Env) -> Simulation | None:
    """Find the simulation behind an environment; None if it is not MuJoCo."""
    level: list[Any] = [env.unwrapped]
    for _ in range(DEPTH):
        for holder in level:
            if _pair(holder) is not None:
                return Simulation(holder)
        level = [value for holder in level for value in _parts(holder)]
    return None


def _pair(holder: Any) -> Any:  # noqa: ANN401 - a model and data, or None
    own = attributes(holder)
    physics: Any = own.get("physics") or (holder.physics if hasattr(type(holder), "physics") else None)
    if _is_physics(physics):
        return physics.model.ptr, physics.data.ptr
    values = [own.get("model"), own.get("data"), *_items(own)]
    data = next((value for value in values if isinstance(value, mujoco.MjData)), None)
    if data is None:
        return None
    models = [value for value in values if isinstance(value, mujoco.MjModel)]
    return next((model for model in models if model is data.model), models[0] if models else data.model), data


def _is_physics(value: object) -> bool:
    """Whether it is dm_control's, which need not be installed to find that it is not."""
    return all(hasattr(getattr(value, name, None), "ptr") for name in ("model", "data"))


def _parts(holder: object) -> Iterator[Any]:
    """The objects that an object has as attributes, or within them."""
    return (value for value in _items(attributes(holder)) if attributes(value) and not isinstance(value, type))


def _items(own: dict[str, Any]) -> Iterator[Any]:
    """Values, and those in tuples, lists and dictionaries."""
    for value in own.values():
        yield value
        if isinstance(value, tuple | list | dict) and len(value) <= FEW:
            yield from value.values() if isinstance(value, dict) else value


def counts(keeper: object, name: str) -> bool:
    """Whether an attribute counts physics steps of a control step, and nothing else: composer's delays are of such steps."""
    return name in attributes(keeper) and "_observation_updater" not in attributes(keeper)


def attributes(holder: object) -> dict[str, Any]:
    """What an object has of its own, in slots too; nothing if it answers for its attributes itself."""
    own = getattr(holder, "__dict__", None)
    slots = [name for name in getattr(type(holder), "__slots__", ()) if isinstance(name, str) and not name.startswith("__")]
    slotted = {name: getattr(holder, name) for name in slots if hasattr(holder, name)}
    return slotted | own if isinstance(own, dict) else slotted


def model_bytes(env: gymnasium.Env) -> bytes:
    """The model behind an environment as MuJoCo writes it; empty if there is none."""
    simulation = open_simulation(env)
    if simulation is None:
        return b""
    buffer = np.empty(mujoco.mj_sizeModel(simulation.model), np.uint8)
    mujoco.mj_saveModel(simulation.model, None, buffer)
    return buffer.tobytes()
