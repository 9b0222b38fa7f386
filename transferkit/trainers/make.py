"""The trainer that a configuration asks for; each is imported when it is asked for, since rsl_rl takes seconds."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import TYPE_CHECKING

import gymnasium
import torch
from numpy.typing import NDArray

from transferkit.envs import derive_spec

if TYPE_CHECKING:
    from transferkit.config import TrainConfig
    from transferkit.policy.base import Policy
    from transferkit.streams import Streams
    from transferkit.trainers.loop import Trainer


def make_trainer(
    policy: Policy,
    config: TrainConfig,
    make_env: Callable[[], gymnasium.Env],
    streams: Streams,
    device: torch.device,
    prior: Sequence[NDArray] | None = None,
) -> Trainer:
    """Make the trainer of `config.algo` around a policy; `prior` are the arrays of a `Batch`, to learn from at first."""
    if config.algo == "ppo":
        from transferkit.trainers.ppo.trainer import PPOTrainer  # noqa: PLC0415

        return PPOTrainer(policy, config, streams, device)
    spec = derive_spec(make_env())
    if config.algo == "dyna-ppo":
        from transferkit.trainers.dyna_ppo import DynaPPOTrainer  # noqa: PLC0415

        return DynaPPOTrainer(policy, spec, config, streams, device)
    from transferkit.trainers.dyna.trainer import DynaTrainer  # noqa: PLC0415

    return DynaTrainer(policy, spec, config, streams, device, prior)
