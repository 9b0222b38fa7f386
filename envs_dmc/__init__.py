"""Environments of dm_control as plain Gymnasium environments, with what Shimmy gets wrong mended."""

from envs_dmc.suite import EPISODE_LIMIT, SuiteTask, make, task_ids
from envs_dmc.task import DmControlEnv

__all__ = ["EPISODE_LIMIT", "DmControlEnv", "SuiteTask", "make", "task_ids"]
