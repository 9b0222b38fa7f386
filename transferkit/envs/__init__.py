"""Environments by id under one contract, their vector form, and the meaning of their numbers."""

from transferkit.envs.make import environment_ids, episode_limit, make_env, time_step
from transferkit.envs.probe import derive_spec
from transferkit.envs.vector import Step, VectorEnv

__all__ = ["Step", "VectorEnv", "derive_spec", "environment_ids", "episode_limit", "make_env", "time_step"]
