"""Re-use control policies across environments: wrap a trained core onto another robot, train it, and prove that it helped.

Names are loaded on first use, so that importing transferkit is instant.
"""

from __future__ import annotations

import importlib
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from transferkit.budget import Budget as Budget
    from transferkit.config import DynaConfig as DynaConfig
    from transferkit.config import DynaPPOConfig as DynaPPOConfig
    from transferkit.config import EnvConfig as EnvConfig
    from transferkit.config import ModelConfig as ModelConfig
    from transferkit.config import NetworkConfig as NetworkConfig
    from transferkit.config import PPOConfig as PPOConfig
    from transferkit.config import TrainConfig as TrainConfig
    from transferkit.config import WrapConfig as WrapConfig
    from transferkit.distillation import DistillConfig as DistillConfig
    from transferkit.distillation import distill as distill
    from transferkit.envs import derive_spec as derive_spec
    from transferkit.envs import make_env as make_env
    from transferkit.envs import vary as vary
    from transferkit.errors import ArtifactError as ArtifactError
    from transferkit.errors import ConfigError as ConfigError
    from transferkit.errors import DimensionError as DimensionError
    from transferkit.errors import DivergedError as DivergedError
    from transferkit.errors import EnvironmentContractError as EnvironmentContractError
    from transferkit.errors import InterruptedRunError as InterruptedRunError
    from transferkit.errors import NotFiniteError as NotFiniteError
    from transferkit.errors import RecordingError as RecordingError
    from transferkit.errors import RemoteError as RemoteError
    from transferkit.errors import RunDirectoryError as RunDirectoryError
    from transferkit.errors import RunInUseError as RunInUseError
    from transferkit.errors import SettingError as SettingError
    from transferkit.errors import TransferkitError as TransferkitError
    from transferkit.errors import UnknownNameError as UnknownNameError
    from transferkit.evaluation import Evaluation as Evaluation
    from transferkit.evaluation import evaluate as evaluate
    from transferkit.export import export_descriptor as export_descriptor
    from transferkit.export import export_leapp as export_leapp
    from transferkit.export import export_onnx as export_onnx
    from transferkit.importing import import_core as import_core
    from transferkit.matching import load_match as load_match
    from transferkit.matching import save_match as save_match
    from transferkit.pairing import Pairing as Pairing
    from transferkit.play.episodes import Shown as Shown
    from transferkit.play.episodes import play_episodes as play_episodes
    from transferkit.policy.base import Policy as Policy
    from transferkit.policy.core import Core as Core
    from transferkit.policy.health import Health as Health
    from transferkit.policy.health import health as health
    from transferkit.policy.make import scratch_policy as scratch_policy
    from transferkit.policy.make import wrap as wrap
    from transferkit.policy.matches import match as match
    from transferkit.policy.saved import load_policy as load_policy
    from transferkit.record.play import Subject as Subject
    from transferkit.record.play import record_episodes as record_episodes
    from transferkit.record.reader import read_transitions as read_transitions
    from transferkit.record.replay import replay_recording as replay_recording
    from transferkit.run import Result as Result
    from transferkit.spec import Actuator as Actuator
    from transferkit.spec import Element as Element
    from transferkit.spec import IOSpec as IOSpec
    from transferkit.spec import Joint as Joint
    from transferkit.subject import load_subject as load_subject
    from transferkit.training import run_training as run_training
    from transferkit.training import train as train
    from transferkit.zoo.artifact import load_core as load_core

_HOMES = {
    "budget": ("Budget",),
    "config": (
        "DynaConfig",
        "DynaPPOConfig",
        "EnvConfig",
        "ModelConfig",
        "NetworkConfig",
        "PPOConfig",
        "TrainConfig",
        "WrapConfig",
    ),
    "distillation": ("DistillConfig", "distill"),
    "envs": ("derive_spec", "make_env", "vary"),
    "errors": (
        "ArtifactError",
        "ConfigError",
        "DimensionError",
        "DivergedError",
        "EnvironmentContractError",
        "InterruptedRunError",
        "NotFiniteError",
        "RecordingError",
        "RemoteError",
        "RunDirectoryError",
        "RunInUseError",
        "SettingError",
        "TransferkitError",
        "UnknownNameError",
    ),
    "evaluation": ("Evaluation", "evaluate"),
    "export": ("export_descriptor", "export_leapp", "export_onnx"),
    "importing": ("import_core",),
    "matching": ("load_match", "save_match"),
    "pairing": ("Pairing",),
    "play.episodes": ("Shown", "play_episodes"),
    "policy.base": ("Policy",),
    "policy.core": ("Core",),
    "policy.health": ("Health", "health"),
    "policy.make": ("scratch_policy", "wrap"),
    "policy.matches": ("match",),
    "policy.saved": ("load_policy",),
    "record.play": ("Subject", "record_episodes"),
    "record.reader": ("read_transitions",),
    "record.replay": ("replay_recording",),
    "run": ("Result",),
    "spec": ("Actuator", "Element", "IOSpec", "Joint"),
    "subject": ("load_subject",),
    "training": ("run_training", "train"),
    "zoo.artifact": ("load_core",),
}
_HOME = {name: f"transferkit.{module}" for module, names in _HOMES.items() for name in names}

__version__ = "0.2.0"


def __getattr__(name: str) -> object:
    if name not in _HOME:
        raise AttributeError(f"module 'transferkit' has no attribute '{name}'")
    return getattr(importlib.import_module(_HOME[name]), name)


def __dir__() -> list[str]:
    return sorted(_HOME)
