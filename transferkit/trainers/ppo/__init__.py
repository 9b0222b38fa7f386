"""PPO: rsl_rl's algorithm, with exact budgets, exact bootstrapping and a learning rate per part."""

from transferkit.trainers.ppo.algorithm import PPO
from transferkit.trainers.ppo.rollout import RolloutRule, collect
from transferkit.trainers.ppo.trainer import PPOTrainer

__all__ = ["PPO", "PPOTrainer", "RolloutRule", "collect"]
