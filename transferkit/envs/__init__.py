"""Environments by id under one contract, their vector form, episodes in them, and the meaning of their numbers."""

from transferkit.envs.make import (
    NO_LIMIT,
    dims,
    dims_of,
    environment_ids,
    episode_limit,
    failed,
    id_from_file,
    make_env,
    name_of,
    time_step,
)
from transferkit.envs.probe import derive_spec
from transferkit.envs.rollout import Actor, Transition, rollout
from transferkit.envs.simulation import Simulation, open_simulation
from transferkit.envs.vector import Count, Step, VectorEnv

__all__ = [
    "NO_LIMIT",
    "Actor",
    "Count",
    "Simulation",
    "Step",
    "Transition",
    "VectorEnv",
    "derive_spec",
    "dims",
    "dims_of",
    "environment_ids",
    "episode_limit",
    "failed",
    "id_from_file",
    "make_env",
    "name_of",
    "open_simulation",
    "rollout",
    "time_step",
]
