"""PPO: rsl_rl's algorithm, with exact budgets, exact bootstrapping and a learning rate per part."""
