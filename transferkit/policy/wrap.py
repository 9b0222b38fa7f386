"""`wrap`: a core and an environment to a policy, and `build`: a policy from what a run directory holds."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace
from typing import Any

import gymnasium

from transferkit.config import PRESETS, WrapConfig, preset_version
from transferkit.envs import derive_spec
from transferkit.errors import ConfigError, DimensionError, UnknownNameError
from transferkit.nn import Architecture, Normalizer, PolicyNet
from transferkit.policy.base import ConstantPolicy, Policy, ScratchPolicy
from transferkit.policy.core import Core, Origin
from transferkit.policy.match import Match, match, padded
from transferkit.policy.paper import PaperSandwich
from transferkit.policy.sandwich import Sandwich
from transferkit.spec import IOSpec
from transferkit.streams import Streams

SEEDED = ("input_adapter", "output_adapter", "residual")
"""Parts that draw their first weights, each from a stream of its own."""


def wrap(
    core: Core,
    env: str | gymnasium.Env | IOSpec,
    *,
    preset: str = "default",
    config: WrapConfig | None = None,
    member: int = 0,
    seed: int = 0,
    **options: Any,  # noqa: ANN401 - the fields of WrapConfig
) -> Policy:
    """Build a core into a policy for another environment; the core itself is copied and stays as it is.

    Args:
        core: from `transferkit.load_core`.
        env: the target, by id, as an environment (its state is lost: reset it), or as an `IOSpec`.
        preset: whose sandwich to build: `default`, `paper`, or a version of them, such as `default-v1`.
        config: all options at once, in place of the preset.
        member: which of the core's source seeds.
        seed: of the random adapters.
        **options: any field of `WrapConfig`, over the preset: `tap`, `adapter`, `freeze`, `lr_scale`, `residual`, ...

    Raises:
        UnknownNameError: an unknown option or preset, or a part that does not exist.
        ConfigError: a value out of its range, or `adapter="semantic"` if nothing matches.
        DimensionError: the core's card and its weights, or the paper's sandwich and the core, do not fit.
    """
    config = _configure(config or PRESETS["ppo"][preset_version("ppo", preset)].wrap, options)
    target = env if isinstance(env, IOSpec) else derive_spec(env)
    source = core.spec
    _check_dims(core.architecture, source, core.id)
    network, normalizer = core.network(member), core.normalizer(member)
    generators = {name: Streams(seed).torch(f"{name} initialisation") for name in SEEDED}
    if config.structure == "paper":
        return PaperSandwich(network, (source, target), config, generators)
    matched = _match(config, source, target)
    return Sandwich(network, normalizer, (source, target), config, matched, generators, origin=Origin(core, member, matched))


def build(blueprint: Mapping[str, Any]) -> Policy:
    """Build the policy of a blueprint with zero weights; load its state dict next.

    Raises:
        KeyError, TypeError, ValueError: not a blueprint of this version.
    """
    if blueprint["kind"] == "constant":
        return ConstantPolicy(blueprint["obs_dim"], blueprint["act_dim"])
    if blueprint["kind"] == "scratch":
        architecture = Architecture.from_json(blueprint["architecture"])
        return ScratchPolicy.create(architecture, None, init_std=1.0, normalize=blueprint["normalize"])
    network = PolicyNet(Architecture.from_json(blueprint["core"]))
    specs = IOSpec.from_json(blueprint["source"]), IOSpec.from_json(blueprint["target"])
    if blueprint["kind"] == "paper":
        return PaperSandwich(network, specs, PRESETS["ppo"]["paper-v1"].wrap, None)
    options = {name: blueprint[name] for name in ("tap", "adapter", "finetune", "residual")}
    normalizer = Normalizer(specs[0].obs_dim) if blueprint["source_normalizer"] else None
    config = WrapConfig(**options, lr_scale={}, init_std=1.0)
    return Sandwich(network, normalizer, specs, config, _match(config, *specs), None)


def as_saved(policy: Policy) -> Policy:
    """Copy a policy with memory of its own, as `load_policy` makes it.

    Training keeps the weights as views of one buffer, and their alignment changes the last bits of an action.
    """
    copy = build(policy.blueprint())
    copy.load_state_dict(policy.state_dict())
    return copy


def _configure(config: WrapConfig, options: Mapping[str, Any]) -> WrapConfig:
    known = WrapConfig.__dataclass_fields__
    for name in options:
        if name not in known:
            raise UnknownNameError("option of wrap", name, list(known))
    return replace(config, **options)


def _match(config: WrapConfig, source: IOSpec, target: IOSpec) -> Match | None:
    if config.adapter == "random":
        return None
    if config.adapter == "pad":
        return padded(source, target)
    result = match(source, target)
    if result.holds:
        return result
    if config.adapter == "semantic":
        raise ConfigError(
            f"wrap.adapter='semantic': nothing in {target.env_id} means what {source.env_id}'s observations and actions mean",
            remedy="use {wrap.adapter=random}",
        )
    return None


def _check_dims(architecture: Architecture, source: IOSpec, core_id: str) -> None:
    core, card = (architecture.obs_dim, architecture.act_dim), (source.obs_dim, source.act_dim)
    if core != card:
        raise DimensionError(
            f"core {core_id}: its network takes {core[0]} observations and {core[1]} actions, its card says {card[0]} and "
            f"{card[1]}",
            topic="verification",
        )
