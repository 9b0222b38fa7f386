"""The trainer that a configuration asks for."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import TYPE_CHECKING

import gymnasium
import torch
from numpy.typing import NDArray

from transferkit.envs import derive_spec
from transferkit.trainers.dyna.replay import Batch
from transferkit.trainers.dyna.trainer import DynaTrainer

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
        from transferkit.trainers.ppo.trainer import PPOTrainer  # noqa: PLC0415 - rsl_rl takes seconds to import

        return PPOTrainer(policy, config, streams, device)
    spec = derive_spec(make_env())
    if config.algo == "dyna-ppo":
        from transferkit.trainers.dyna_ppo import DynaPPOTrainer  # noqa: PLC0415 - rsl_rl again

        return DynaPPOTrainer(policy, spec, config, streams, device)
    rows = None if prior is None else Batch(*map(torch.from_numpy, prior))
    return DynaTrainer(policy, spec, config, streams, device, rows)
