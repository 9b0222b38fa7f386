"""dm_control suite tasks as plain Gymnasium environments, with what Shimmy gets wrong mended."""

from envs_dmc.suite import EPISODE_LIMIT, SuiteTask, make, task_ids

__all__ = ["EPISODE_LIMIT", "SuiteTask", "make", "task_ids"]
