"""The untrained policy of a run: around a core, or from scratch."""

from __future__ import annotations

import gymnasium
import torch

from transferkit.config import NetworkConfig, TrainConfig
from transferkit.envs import dims, make_env
from transferkit.nn import Architecture
from transferkit.policy.base import Policy, ScratchPolicy
from transferkit.policy.core import Core
from transferkit.policy.wrap import wrap
from transferkit.streams import Streams


def new_policy(config: TrainConfig, core: Core | None) -> Policy:
    """Make the policy that a configuration describes."""
    if core is not None:
        return wrap(core, config.env, config=config.wrap, member=config.member, seed=config.seed)
    return scratch_policy(config.env, config.network, seed=config.seed)


def scratch_policy(env: str | gymnasium.Env, network: NetworkConfig | None = None, *, seed: int = 0) -> ScratchPolicy:
    """Make a new network for an environment, without a core.

    Args:
        env: an id, or an environment of your own.
        network: its layers, deviation and initialisation; by default those of PPO's newest preset.
        seed: of the initial weights; with the seed of `train` it is the network that a run from scratch begins with.

    Raises:
        UnknownNameError: no environment has this id.
        EnvironmentContractError: the environment's spaces do not fit.
    """
    made = make_env(env)
    obs_dim, act_dim = dims(made)
    if isinstance(env, str):
        made.close()
    return _scratch(obs_dim, act_dim, network or NetworkConfig(), Streams(seed).torch("policy initialisation"))


def _scratch(obs_dim: int, act_dim: int, config: NetworkConfig, generator: torch.Generator) -> ScratchPolicy:
    architecture = Architecture(
        obs_dim, act_dim, config.hidden, config.activation, config.std, config.initialization, config.squash
    )
    return ScratchPolicy.create(architecture, generator, init_std=config.init_std, normalize=config.normalize_observation)
