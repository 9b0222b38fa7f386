"""Configuration as frozen dataclasses: one source for defaults, command-line flags and records."""

from transferkit.config.dyna import DYNA_PRESETS, DynaConfig
from transferkit.config.names import Algorithm, Preset
from transferkit.config.ppo import PPO_PRESETS, PPOConfig
from transferkit.config.train import TrainConfig, preset
from transferkit.config.wrap import WRAP_PRESETS, WrapConfig

__all__ = [
    "DYNA_PRESETS",
    "PPO_PRESETS",
    "WRAP_PRESETS",
    "Algorithm",
    "DynaConfig",
    "PPOConfig",
    "Preset",
    "TrainConfig",
    "WrapConfig",
    "preset",
]
