"""MuJoCo's integration state: all that the next step of a simulation depends on."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from transferkit.physics import mujoco

if TYPE_CHECKING:
    from transferkit.envs import Simulation

FULL_STATE = int(mujoco.mjtState.mjSTATE_INTEGRATION)

NAMED = {
    "time": int(mujoco.mjtState.mjSTATE_TIME),
    "qpos": int(mujoco.mjtState.mjSTATE_QPOS),
    "qvel": int(mujoco.mjtState.mjSTATE_QVEL),
    "control": int(mujoco.mjtState.mjSTATE_CTRL),
}
"""Parts that are recorded under names too."""


def state_size(simulation: Simulation) -> int:
    """Count the numbers in `integration_state`."""
    return mujoco.mj_stateSize(simulation.model, FULL_STATE)


def integration_state(simulation: Simulation, size: int) -> NDArray[np.float64]:
    """Read the present state, `(size,)`."""
    state = np.empty(size)
    mujoco.mj_getState(simulation.model, simulation.data, state, FULL_STATE)
    return state


def named_parts(simulation: Simulation, states: NDArray[np.float64]) -> dict[str, NDArray[np.float64]]:
    """Cut the `NAMED` parts `(N, k)` out of states `(N, size)`, which hold their parts in the order of MuJoCo's bits."""
    parts = {}
    for name, part in NAMED.items():
        before = mujoco.mj_stateSize(simulation.model, FULL_STATE & (part - 1))
        parts[name] = states[:, before : before + mujoco.mj_stateSize(simulation.model, part)]
    return parts
