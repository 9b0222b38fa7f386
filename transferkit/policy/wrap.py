"""`wrap`: a core and an environment to a policy, and the rebuilding of a policy from what a run directory holds."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace
from typing import Any

import gymnasium

from transferkit.config import WRAP_PRESETS, Preset, WrapConfig
from transferkit.envs.probe import derive_spec
from transferkit.errors import ConfigError, DimensionError
from transferkit.nn import Architecture, Normalizer, PolicyNet
from transferkit.policy.base import ConstantPolicy, Policy, ScratchPolicy
from transferkit.policy.core import Core, Origin
from transferkit.policy.match import Match, match, padded
from transferkit.policy.paper import PaperSandwich
from transferkit.policy.sandwich import Sandwich
from transferkit.run.streams import Streams
from transferkit.spec import IOSpec

INIT_STD = 0.6
"""Standard deviation of actions that no core action was matched with; PPO's own default."""


def wrap(
    core: Core,
    env: str | gymnasium.Env | IOSpec,
    *,
    preset: Preset = "default",
    config: WrapConfig | None = None,
    member: int = 0,
    seed: int = 0,
    init_std: float = INIT_STD,
    **options: Any,  # noqa: ANN401 - the fields of WrapConfig
) -> Policy:
    """Build a core into a policy for another environment; the core itself is copied and stays as it is.

    Args:
        core: from `transferkit.load_core`.
        env: the target, by id, as an environment (its state is lost: reset it), or as an `IOSpec`.
        preset: the healthy default, or the paper's sandwich.
        config: all options at once, in place of the preset.
        member: which of the core's source seeds.
        seed: of the random adapters.
        init_std: initial standard deviation of unmatched actions.
        **options: any field of `WrapConfig`, over the preset: `tap`, `adapter`, `freeze`, `lr_scale`, `residual`, ...

    Raises:
        ConfigError: an unknown option, a part that does not exist, `adapter="semantic"` where nothing matches.
        DimensionError: the core's card and its weights, or the paper's sandwich and the core, do not fit.
    """
    config = _configure(config or WRAP_PRESETS[preset], options)
    target = env if isinstance(env, IOSpec) else derive_spec(env)
    source = core.spec
    _check_dims(core.architecture, source, core.id)
    network, normalizer = core.network(member), core.normalizer(member)
    streams = Streams(seed)
    generators = {name: streams.torch(f"{name} initialisation") for name in ("input_adapter", "output_adapter", "residual")}
    if config.structure == "paper":
        return PaperSandwich(network, (source, target), config, generators)
    found = _match(config, source, target)
    origin = Origin(core, member, found)
    return Sandwich(network, normalizer, (source, target), config, found, generators, init_std=init_std, origin=origin)


def build(blueprint: Mapping[str, Any]) -> Policy:
    """The policy of a blueprint with zero weights; load its state dict next.

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
        return PaperSandwich(network, specs, WRAP_PRESETS["paper"], None)
    options = {name: blueprint[name] for name in ("tap", "adapter", "finetune", "residual")}
    normalizer = Normalizer(specs[0].obs_dim) if blueprint["source_normalizer"] else None
    config = WrapConfig(**options, lr_scale={})
    return Sandwich(network, normalizer, specs, config, _match(config, *specs), None, init_std=1.0)


def _configure(config: WrapConfig, options: Mapping[str, Any]) -> WrapConfig:
    try:
        return replace(config, **options)
    except TypeError:
        known = ", ".join(WrapConfig.__dataclass_fields__)
        unknown = ", ".join(name for name in options if name not in WrapConfig.__dataclass_fields__)
        raise ConfigError(f"wrap has no option {unknown}; the options are {known}") from None


def _match(config: WrapConfig, source: IOSpec, target: IOSpec) -> Match | None:
    if config.adapter == "random":
        return None
    if config.adapter == "pad":
        return padded(source, target)
    found = match(source, target)
    if found.found:
        return found
    if config.adapter == "semantic":
        raise ConfigError(
            f"adapter='semantic' finds nothing in {target.env_id} that means what {source.env_id}'s observations and "
            "actions mean; use adapter='random'"
        )
    return None


def _check_dims(architecture: Architecture, source: IOSpec, core_id: str) -> None:
    core, card = (architecture.obs_dim, architecture.act_dim), (source.obs_dim, source.act_dim)
    if core != card:
        raise DimensionError(
            f"core {core_id}: its network takes {core[0]} observations and {core[1]} actions, its card says {card[0]} and "
            f"{card[1]}; run `transferkit zoo verify {core_id}`"
        )
