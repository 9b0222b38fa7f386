"""The arms of a comparison: the transferred core, and controls that differ from it in one thing each.

All are policies of transferkit, so that training, budget, streams and evaluation are the same; arms of one seed share every
random stream that they have in common.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace

import torch
from torch import nn

from transferkit.config import TrainConfig, with_settings
from transferkit.policy.base import ConstantPolicy, Policy
from transferkit.policy.core import Core
from transferkit.policy.health import play
from transferkit.policy.make import new_policy

PROBE_STEPS = 500
"""Random steps in the target that measure the scale of a policy's actions."""

Arm = Callable[[TrainConfig, Core], tuple[TrainConfig, Policy]]
"""From the transfer's configuration and its core to the arm's configuration and its untrained policy."""


def transfer(config: TrainConfig, core: Core) -> tuple[TrainConfig, Policy]:
    """The core, wrapped."""
    return config, new_policy(config, core)


def scratch(config: TrainConfig) -> tuple[TrainConfig, Policy]:
    """The trainer's own network, no core."""
    config = replace(config, core=None)
    return config, new_policy(config, None)


def scratch_matched(config: TrainConfig, core: Core) -> tuple[TrainConfig, Policy]:
    """No core, and layers of the width at which the parameters are as many as the transfer's."""
    wanted = count_parameters(new_policy(config, core))

    def with_width(width: int) -> tuple[TrainConfig, Policy]:
        return scratch(replace(config, network=replace(config.network, hidden=(width, width))))

    low, high = 1, 4096
    while high - low > 1:
        middle = (low + high) // 2
        low, high = (middle, high) if count_parameters(with_width(middle)[1]) <= wanted else (low, middle)
    return with_width(low)


def random_core(config: TrainConfig, core: Core) -> tuple[TrainConfig, Policy]:
    """A core of the same architecture, freshly initialised; it explores as training from scratch does."""
    return transfer(trusting(config), core.randomized(config.seed, init_std=config.wrap.init_std))


def random_matched(config: TrainConfig, core: Core) -> tuple[TrainConfig, Policy]:
    """A random core whose first actions are as large, and as noisy, as the transfer's."""
    config = trusting(config)
    reference, policy = new_policy(config, core), new_policy(config, core.randomized(config.seed))
    observation = torch.from_numpy(play(config.env, PROBE_STEPS, config.seed))
    with torch.no_grad():
        wanted, actual = (made(observation)[0].square().mean().sqrt() for made in (reference, policy))
        for parameter in last_layer(policy).parameters():
            parameter.mul_(wanted / actual.clamp(min=1e-8))
        stds = {name: tensor for name, tensor in reference.state_dict().items() if "log_std" in name or "std_adapter" in name}
        policy.load_state_dict({**policy.state_dict(), **stds})
    return config, policy


def shuffled_core(config: TrainConfig, core: Core) -> tuple[TrainConfig, Policy]:
    """The core's weights, permuted within each tensor."""
    return transfer(trusting(config), core.shuffled(config.seed))


def frozen(config: TrainConfig, core: Core) -> tuple[TrainConfig, Policy]:
    """The core, whose own layers never learn."""
    return transfer(with_frozen(config, "core"), core)


def frozen_random(config: TrainConfig, core: Core) -> tuple[TrainConfig, Policy]:
    """A random core whose own layers never learn."""
    return random_core(with_frozen(config, "core"), core)


def constant(config: TrainConfig) -> tuple[TrainConfig, Policy]:
    """A Gaussian that does not see the observation."""
    config, policy = scratch(config)
    return config, ConstantPolicy(policy.obs_dim, policy.act_dim, init_std=config.network.init_std)


def padded(config: TrainConfig, core: Core) -> tuple[TrainConfig, Policy]:
    """The core on the target's first observations and actions, zeros for what is missing, instead of adapters."""
    config = with_frozen(config, "input_adapter", "output_adapter")
    return transfer(replace(config, wrap=replace(config.wrap, adapter="pad")), core)


ARMS: dict[str, Arm] = {
    "transfer": transfer,
    "scratch-matched": scratch_matched,
    "random": random_core,
    "random-matched": random_matched,
    "shuffled": shuffled_core,
    "frozen": frozen,
    "frozen-random": frozen_random,
    "padded": padded,
}
WITHOUT_CORE: dict[str, Callable[[TrainConfig], tuple[TrainConfig, Policy]]] = {"scratch": scratch, "constant": constant}
"""The same for every core, so run once."""

WITHOUT_MEMBER = (*WITHOUT_CORE, "scratch-matched")
"""The same for every member of a core, so run once for all of them."""

ZERO_ACTION, RANDOM_ACTION = "zero-action", "random-action"
UNTRAINED = (ZERO_ACTION, RANDOM_ACTION)
"""Evaluated and never trained; the same for every trainer too."""


def trusting(config: TrainConfig) -> TrainConfig:
    """The configuration without probation, which would make most controls runs from scratch."""
    return with_settings(config, {"wrap.probation": 0})


def with_frozen(config: TrainConfig, *parts: str) -> TrainConfig:
    """The configuration with parts that never learn."""
    return replace(config, wrap=replace(config.wrap, freeze={**config.wrap.freeze, **dict.fromkeys(parts, 1.0)}))


def count_parameters(policy: Policy) -> int:
    """Numbers that can learn."""
    return sum(parameter.numel() for parameter in policy.parameters())


def last_layer(policy: Policy) -> nn.Module:
    """The layer that makes the mean action, in the default sandwich or in the paper's."""
    parts = policy.parts()
    found = parts.get("output_adapter", parts.get("mean_adapter"))
    assert isinstance(found, nn.Module)
    return found
