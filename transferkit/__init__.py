"""Re-use control policies across environments: wrap a trained core onto another robot, train it, and prove that it helped.

Names are loaded on first use, so that importing transferkit is instant.
"""

from __future__ import annotations

import importlib
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from transferkit.budget import Budget as Budget
    from transferkit.config import DynaConfig as DynaConfig
    from transferkit.config import PPOConfig as PPOConfig
    from transferkit.config import TrainConfig as TrainConfig
    from transferkit.config import WrapConfig as WrapConfig
    from transferkit.envs import derive_spec as derive_spec
    from transferkit.envs import make_env as make_env
    from transferkit.errors import TransferkitError as TransferkitError
    from transferkit.evaluation import evaluate as evaluate
    from transferkit.policy import health as health
    from transferkit.policy import wrap as wrap
    from transferkit.trained import load_policy as load_policy
    from transferkit.transfer import run_training as run_training
    from transferkit.transfer import train as train
    from transferkit.zoo.artifact import load_core as load_core

_HOME = {
    "Budget": "transferkit.budget",
    "DynaConfig": "transferkit.config",
    "PPOConfig": "transferkit.config",
    "TrainConfig": "transferkit.config",
    "TransferkitError": "transferkit.errors",
    "WrapConfig": "transferkit.config",
    "derive_spec": "transferkit.envs",
    "evaluate": "transferkit.evaluation",
    "health": "transferkit.policy",
    "load_core": "transferkit.zoo.artifact",
    "load_policy": "transferkit.trained",
    "make_env": "transferkit.envs",
    "run_training": "transferkit.transfer",
    "train": "transferkit.transfer",
    "wrap": "transferkit.policy",
}

__all__ = sorted(_HOME)  # noqa: PLE0605 - the keys above, once
__version__ = "0.1.0"


def __getattr__(name: str) -> Any:  # noqa: ANN401 - any public name
    if name not in _HOME:
        raise AttributeError(f"module 'transferkit' has no attribute '{name}'")
    return getattr(importlib.import_module(_HOME[name]), name)


def __dir__() -> list[str]:
    return __all__
