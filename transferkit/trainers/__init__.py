"""Trainers: PPO, DYNA-DDPG and DYNA-PPO behind one interface, and the loop that drives each of them."""

from transferkit.trainers.loop import Trainer, migrated_checkpoint, run_loop
from transferkit.trainers.make import make_trainer

__all__ = ["Trainer", "make_trainer", "migrated_checkpoint", "run_loop"]
