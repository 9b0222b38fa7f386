"""Environments by id under one contract, their vector form, episodes in them, and the meaning of their numbers."""

from transferkit.envs.broken import failed
from transferkit.envs.contract import NO_LIMIT, dims, episode_limit, solved_return, time_step
from transferkit.envs.make import copies_of, dims_of, make_env, opened, recorded, rules_of, vary
from transferkit.envs.mirror import Mirror, find_mirror
from transferkit.envs.names import EnvLike, name_of
from transferkit.envs.probe import derive_spec
from transferkit.envs.rollout import Actor, Transition, rollout
from transferkit.envs.simulation import Simulation, open_simulation
from transferkit.envs.source import environment_ids, id_from_file, is_maker, names_module
from transferkit.envs.vector import Count, Step, VectorEnv
from transferkit.envs.written import is_written, written

__all__ = [
    "NO_LIMIT",
    "Actor",
    "Count",
    "EnvLike",
    "Mirror",
    "Simulation",
    "Step",
    "Transition",
    "VectorEnv",
    "copies_of",
    "derive_spec",
    "dims",
    "dims_of",
    "environment_ids",
    "episode_limit",
    "failed",
    "find_mirror",
    "id_from_file",
    "is_maker",
    "is_written",
    "make_env",
    "name_of",
    "names_module",
    "open_simulation",
    "opened",
    "recorded",
    "rollout",
    "rules_of",
    "solved_return",
    "time_step",
    "vary",
    "written",
]
