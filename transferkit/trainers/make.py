"""The trainer that a configuration asks for; each is imported when it is asked for, since rsl_rl takes seconds."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import TYPE_CHECKING

import torch
from numpy.typing import NDArray

if TYPE_CHECKING:
    from transferkit.config import TrainConfig
    from transferkit.envs import Mirror
    from transferkit.policy.base import Policy
    from transferkit.spec import IOSpec
    from transferkit.streams import Streams
    from transferkit.trainers.loop import Trainer


def make_trainer(
    policy: Policy,
    config: TrainConfig,
    spec_of: Callable[[], IOSpec],
    mirror_of: Callable[[IOSpec], Mirror | None],
    streams: Streams,
    device: torch.device,
    prior: Sequence[NDArray] | None = None,
    *,
    compiles: bool = False,
) -> Trainer:
    """Make the trainer of `config.algo` around a policy.

    Args:
        policy: is trained in place.
        config: the whole run.
        spec_of: derives the spec of the environment, if the trainer needs it.
        mirror_of: finds the environment's mirror image, if the trainer is to learn from that.
        streams: of the run's seed.
        device: of the networks.
        prior: the arrays of a `Batch` of elsewhere, to learn from at first.
        compiles: whether updates are compiled.
    """
    if config.algo == "ppo":
        from transferkit.trainers.ppo.trainer import PPOTrainer  # noqa: PLC0415

        return PPOTrainer(policy, config, streams, device, compiles=compiles)
    if config.algo == "dyna-ppo":
        from transferkit.trainers.dyna_ppo import DynaPPOTrainer  # noqa: PLC0415

        return DynaPPOTrainer(policy, spec_of(), config, streams, device, compiles=compiles)
    from transferkit.trainers.dyna.trainer import DynaTrainer  # noqa: PLC0415

    spec = spec_of()
    mirror = mirror_of(spec) if config.dyna.mirror else None
    return DynaTrainer(policy, spec, config, streams, device, prior, mirror=mirror, compiles=compiles)
