"""DYNA-DDPG: deterministic policy gradient with a learnt model, and the model for others."""

from transferkit.trainers.dyna.diagnostics import diagnose
from transferkit.trainers.dyna.fit import fit
from transferkit.trainers.dyna.imagined_env import ImaginedEnv
from transferkit.trainers.dyna.replay import Batch, ReplayBuffer
from transferkit.trainers.dyna.trainer import DynaTrainer

__all__ = ["Batch", "DynaTrainer", "ImaginedEnv", "ReplayBuffer", "diagnose", "fit"]
