"""PPO: rsl_rl's algorithm, with exact budgets, exact bootstrapping and a learning rate per part."""

from transferkit.ppo.train import train

__all__ = ["train"]
