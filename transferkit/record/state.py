"""MuJoCo's integration state: all that the next step of a simulation depends on."""

# pyright: reportAttributeAccessIssue=false
# mujoco's names come from a compiled module that pyright cannot read.
from __future__ import annotations

import mujoco
import numpy as np
from numpy.typing import NDArray

from transferkit.envs.access import Simulation

FULL_STATE = int(mujoco.mjtState.mjSTATE_INTEGRATION)

NAMED = {
    "time": int(mujoco.mjtState.mjSTATE_TIME),
    "qpos": int(mujoco.mjtState.mjSTATE_QPOS),
    "qvel": int(mujoco.mjtState.mjSTATE_QVEL),
    "control": int(mujoco.mjtState.mjSTATE_CTRL),
}
"""Parts that are recorded under names too."""


def state_size(simulation: Simulation) -> int:
    """Numbers in `integration_state`."""
    return mujoco.mj_stateSize(simulation.model, FULL_STATE)


def integration_state(simulation: Simulation, size: int) -> NDArray[np.float64]:
    """The present state, `(size,)`."""
    state = np.empty(size)
    mujoco.mj_getState(simulation.model, simulation.data, state, FULL_STATE)
    return state


def named_parts(simulation: Simulation, states: NDArray[np.float64]) -> dict[str, NDArray[np.float64]]:
    """The `NAMED` parts `(N, k)` of states `(N, size)`, which hold their parts in the order of MuJoCo's bits."""
    found = {}
    for name, part in NAMED.items():
        before = mujoco.mj_stateSize(simulation.model, FULL_STATE & (part - 1))
        found[name] = states[:, before : before + mujoco.mj_stateSize(simulation.model, part)]
    return found
