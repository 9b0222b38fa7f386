"""DYNA-DDPG: deterministic policy gradient with a learnt model, and the model for others."""
