"""PPO: rsl_rl's algorithm, with exact budgets, exact bootstrapping and a learning rate per part."""

from transferkit.ppo.algorithm import PPO
from transferkit.ppo.train import collect, train

__all__ = ["PPO", "collect", "train"]
