"""Configuration as frozen dataclasses: one source for defaults, command-line flags and records."""

from transferkit.config.dyna import DynaConfig, DynaPPOConfig, ModelConfig
from transferkit.config.env import EnvConfig
from transferkit.config.migrate import migrated_blueprint
from transferkit.config.network import NetworkConfig
from transferkit.config.ppo import PPOConfig
from transferkit.config.presets import PRESETS, SECTIONS, USED, Algorithm, Preset, preset_family, preset_of, preset_version
from transferkit.config.train import TrainConfig, check_read, identity, overrides, with_settings
from transferkit.config.wrap import WrapConfig

__all__ = [
    "PRESETS",
    "SECTIONS",
    "USED",
    "Algorithm",
    "DynaConfig",
    "DynaPPOConfig",
    "EnvConfig",
    "ModelConfig",
    "NetworkConfig",
    "PPOConfig",
    "Preset",
    "TrainConfig",
    "WrapConfig",
    "check_read",
    "identity",
    "migrated_blueprint",
    "overrides",
    "preset_family",
    "preset_of",
    "preset_version",
    "with_settings",
]
