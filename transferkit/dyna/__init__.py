"""DYNA-DDPG: deterministic policy gradient with a learnt model, and the model for others."""

from transferkit.dyna.train import train

__all__ = ["train"]
