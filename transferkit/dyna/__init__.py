"""DYNA-DDPG: deterministic policy gradient with a learnt model, and the model for others."""

from transferkit.dyna.diagnostics import diagnose
from transferkit.dyna.model import fit
from transferkit.dyna.replay import Batch, ReplayBuffer
from transferkit.dyna.train import train
from transferkit.dyna.world import ImaginedEnv

__all__ = ["Batch", "ImaginedEnv", "ReplayBuffer", "diagnose", "fit", "train"]
