"""Making policies: around a core (`wrap`), and from scratch (`scratch_policy`)."""

from __future__ import annotations

import logging
from collections.abc import Mapping
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING, Any

from transferkit.config import NetworkConfig, WrapConfig, preset_of
from transferkit.config.checks import check_kind
from transferkit.config.wrap import check_asked, check_found
from transferkit.envs import derive_spec, dims_of
from transferkit.errors import ConfigError, DimensionError, UnknownNameError
from transferkit.matching import Match, match_for
from transferkit.nn import Architecture
from transferkit.pairing import Pairing
from transferkit.policy.base import ScratchPolicy
from transferkit.policy.blueprints import SEEDED
from transferkit.policy.core import Core, Origin
from transferkit.policy.paper import PaperSandwich
from transferkit.policy.sandwich import Sandwich
from transferkit.spec import IOSpec
from transferkit.streams import Streams

if TYPE_CHECKING:
    from transferkit.config import Algorithm, TrainConfig
    from transferkit.envs import EnvLike
    from transferkit.policy.base import Policy
    from transferkit.policy.composed import Composed

LOGGER = logging.getLogger("transferkit")


def wrap(
    core: Core,
    env: EnvLike | IOSpec,
    *,
    preset: str = "default",
    algo: Algorithm = "ppo",
    config: WrapConfig | None = None,
    member: int = 0,
    match: str | Path | Pairing | Match | None = None,
    seed: int = 0,
    **options: Any,  # noqa: ANN401 - the fields of WrapConfig
) -> Policy:
    """Build a core into a policy for another environment; the core itself is copied and stays as it is.

    Args:
        core: from `transferkit.load_core`, of a zoo or of a finished run.
        env: the target, in any form that `make_env` takes (the state of one that is made is lost: reset it), or its `IOSpec`.
        preset: whose sandwich to build: `default`, `paper`, or a version of them, such as `default-v1`.
        algo: the trainer whose preset that is.
        config: all options at once, in place of the preset.
        member: which of the core's source seeds.
        match: how the core stands on the target, in place of what is found: a file from `transferkit match`, perhaps edited, or
            what `transferkit.match` returns.
        seed: of the random adapters.
        **options: any field of `WrapConfig`, over the preset: `tap`, `adapter`, `freeze`, `lr_scale`, `residual`, ...

    Raises:
        UnknownNameError: an unknown option, preset or trainer, or a part or a name in the match that does not exist.
        ConfigError: something else than a core, a value out of its range, or `adapter="semantic"` if nothing matches.
        DimensionError: the core's card and its weights, or the paper's sandwich and the core, do not fit.
    """
    check_kind("core", core, Core, "get it from load_core")
    if config is not None:
        check_kind("config", config, WrapConfig, "give single options by name instead, such as tap='action'")
    if match is not None:
        check_kind("match", match, (str, Path, Pairing, Match), "give a file, or what transferkit.match returns")
    config = _configure(config or preset_of(algo, preset).wrap, options)
    check_found(options, config, match)
    check_asked(options, config)
    target = env if isinstance(env, IOSpec) else derive_spec(env)
    source = core.spec
    _check_dims(core.architecture, source, core.id)
    network, normalizer = core.network(member), core.normalizer(member)
    generators = {name: Streams(seed).torch(f"{name} initialisation") for name in SEEDED}
    if config.structure == "paper":
        if match is not None:
            raise ConfigError("{match} has no effect on {wrap.structure=paper}", remedy="leave one of them out")
        return PaperSandwich(network, (source, target), config, generators, origin=Origin(core, member, None))
    matched = match_for(config, source, target, match)
    if matched is None and config.adapter == "auto":
        LOGGER.warning("nothing of %s means anything on %s: its adapters are random", core.id, target.env_id)
    if network.architecture.squash and matched is not None and not _copies_actions(matched):
        config = replace(config, tap="action")
    return Sandwich(network, normalizer, (source, target), config, matched, generators, origin=Origin(core, member, matched))


def new_policy(config: TrainConfig, core: Core | None, match: Match | None = None) -> Policy:
    """Make the policy that a configuration describes; with the match that it began with, if it was made before."""
    if core is not None:
        given = config.match if match is None else match
        return wrap(core, config.env, config=config.wrap, member=config.member, match=given, seed=config.seed)
    return scratch_policy(config.env, config.network, seed=config.seed)


def scratch_policy(env: EnvLike, network: NetworkConfig | None = None, *, seed: int = 0) -> ScratchPolicy:
    """Make a new network for an environment, without a core.

    Args:
        env: in any form that `make_env` takes.
        network: its layers, deviation and initialisation; by default those of PPO's newest preset.
        seed: of the initial weights; with the seed of `train` it is the network that a run from scratch begins with.

    Raises:
        UnknownNameError: no environment has this id.
        EnvironmentContractError: the environment's spaces do not fit.
    """
    network = NetworkConfig() if network is None else network
    check_kind("network", network, NetworkConfig, "make one, such as NetworkConfig(hidden=(64, 64))")
    obs_dim, act_dim = dims_of(env)
    kinds = network.activation, network.std, network.initialization, network.squash
    architecture = Architecture(obs_dim, act_dim, network.hidden, *kinds)
    generator = Streams(seed).torch("policy initialisation")
    return ScratchPolicy.create(architecture, generator, init_std=network.init_std, normalize=network.normalize_observation)


def _copies_actions(match: Match) -> bool:
    """Whether each action of the target is one of the core's, as it is or turned round: only then is its tanh the core's."""
    rows = [[weight for weight in row if weight] for row in match.action_weight]
    copied = all(len(row) <= 1 and all(abs(weight) == 1 for weight in row) for row in rows)
    return copied and not match.action_bias


def _configure(config: WrapConfig, options: Mapping[str, Any]) -> WrapConfig:
    known = WrapConfig.__dataclass_fields__
    for name in options:
        if name not in known:
            raise UnknownNameError("option of wrap", name, list(known))
    return replace(config, **options)


def _check_dims(architecture: Architecture | Composed, source: IOSpec, core_id: str) -> None:
    core, card = (architecture.obs_dim, architecture.act_dim), (source.obs_dim, source.act_dim)
    if core != card:
        raise DimensionError(
            f"core {core_id}: its network takes {core[0]} observations and {core[1]} actions, its card says {card[0]} and "
            f"{card[1]}",
            topic="verification",
        )
