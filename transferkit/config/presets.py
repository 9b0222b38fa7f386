"""Presets: named, versioned and frozen settings of each trainer.

A version is never changed once a result names it; a new default is a new version. The classes' own defaults are those of
PPO's `default-v2`, so whoever changes one writes the old value into the versions here (a test holds their hashes).
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import asdict, dataclass, field, replace
from typing import Literal

from transferkit.config.dyna import DynaConfig, DynaPPOConfig, ModelConfig
from transferkit.config.env import EnvConfig
from transferkit.config.network import NetworkConfig
from transferkit.config.ppo import PPOConfig
from transferkit.config.wrap import PAPER_WRAP, WrapConfig
from transferkit.errors import UnknownNameError

Algorithm = Literal["ppo", "dyna-ddpg", "dyna-ppo"]


@dataclass(frozen=True)
class Preset:
    """Every section of a run's settings."""

    env_config: EnvConfig = field(default_factory=EnvConfig)
    network: NetworkConfig = field(default_factory=NetworkConfig)
    ppo: PPOConfig = field(default_factory=PPOConfig)
    dyna: DynaConfig = field(default_factory=DynaConfig)
    dyna_ppo: DynaPPOConfig = field(default_factory=DynaPPOConfig)
    model: ModelConfig = field(default_factory=ModelConfig)
    wrap: WrapConfig = field(default_factory=WrapConfig)


SECTIONS = tuple(Preset.__dataclass_fields__)
USED: Mapping[Algorithm, tuple[str, ...]] = {
    "ppo": ("env_config", "network", "ppo", "wrap"),
    "dyna-ddpg": ("env_config", "network", "dyna", "model", "wrap"),
    "dyna-ppo": ("env_config", "network", "ppo", "dyna_ppo", "model", "wrap"),
}
"""Sections that each trainer reads."""

DDPG_NETWORK = NetworkConfig(hidden=(128, 128), activation="relu", init_std=0.3)

FIVE_CRITICS = DynaConfig(
    critics=5,
    drawn_critics=2,
    pessimism=0.25,
    updates_per_step=10,
    hold_seconds=0.03,
    discount_seconds=None,
    gamma=0.975,
)

HELD_TO_CORE = replace(FIVE_CRITICS, anchor_holds=True, even_updates=True)
"""What was learnt around a core is held to it while it is behind."""

AT_ITS_PEAK = replace(HELD_TO_CORE, keep_peak=True)
"""And what was learnt is kept while it is better."""

MIRRORED = replace(AT_ITS_PEAK, mirror=True, average_share=0.1)
"""And it is learnt from both sides, and averaged."""

TRIED = replace(MIRRORED, keep_tried=True)
"""And an episode has tried what is kept."""

LET_GO = replace(TRIED, anchor_halves=0.025)
"""And it is let go once it is as good as the core."""

IMAGINED_PPO = PPOConfig(rollout="steps", schedule="linear", critic_learning_rate=None)

MECHANISM = WrapConfig(limbs="all", forces="auto", hold=0)
"""A sandwich that is matched by what the two robots are."""

ON_PROBATION = replace(MECHANISM, probation=5)
"""And that is trained only if it is better than doing nothing."""

KEPT = replace(ON_PROBATION, fall_back=True)
"""And whose core stands in for what is learnt until that is as good."""

UNWEAKENED = replace(KEPT, forces="greater")
"""And that does not weaken what drives a lighter robot."""

WORTH_IT = replace(UNWEAKENED, least_gain=0.05)
"""And that refuses a core which comes less far than the margin by which a verdict tells harm."""

CRITIC_FIRST = 0.05
"""Of the budget; beside it retention (Wolczyk et al. 2024) won nothing in trials on Walker2d-v5 and the cart-pole."""

WAITS = PPOConfig(critic_first=CRITIC_FIRST)

LONG = replace(WAITS, least_share=0.002, desired_kl=0.02)
"""And that goes on learning with a large budget: from at most 500 rollouts, each of which may move it four times as far."""

LEAST_STD = 0.2
"""Half-cheetah's core has 0.04, with which PPO learnt nothing more in 20,000 steps (study `ladder`, notes)."""

PRESETS: Mapping[Algorithm, Mapping[str, Preset]] = {
    "ppo": {
        "default-v1": Preset(ppo=IMAGINED_PPO),
        "default-v2": Preset(),
        "default-v3": Preset(wrap=MECHANISM),
        "default-v4": Preset(wrap=ON_PROBATION),
        "default-v5": Preset(ppo=WAITS, wrap=KEPT),
        "default-v6": Preset(ppo=WAITS, wrap=replace(UNWEAKENED, least_std=LEAST_STD)),
        "default-v7": Preset(ppo=WAITS, wrap=replace(WORTH_IT, least_std=LEAST_STD)),
        "default-v8": Preset(ppo=LONG, wrap=replace(WORTH_IT, least_std=LEAST_STD)),
        "paper-v1": Preset(
            EnvConfig(clip_actions=False),
            NetworkConfig(
                hidden=(128, 128), activation="relu", std="head", initialization="paper", normalize_observation=False
            ),
            PPOConfig(
                num_envs=1,
                rollout="episode",
                rollout_steps=1000,
                batch_size=32,
                shuffle=False,
                schedule="step",
                critic_learning_rate=None,
                value_coefficient=1.0,
                max_grad_norm=None,
                value_target="monte-carlo",
                bootstrap_timeouts=False,
                normalize_reward=False,
            ),
            wrap=PAPER_WRAP,
        ),
    },
    "dyna-ddpg": {
        "default-v1": Preset(network=DDPG_NETWORK),
        "default-v2": Preset(network=DDPG_NETWORK, dyna=FIVE_CRITICS, wrap=MECHANISM),
        "default-v3": Preset(network=DDPG_NETWORK, dyna=HELD_TO_CORE, wrap=UNWEAKENED),
        "default-v4": Preset(network=DDPG_NETWORK, dyna=AT_ITS_PEAK, wrap=WORTH_IT),
        "default-v5": Preset(network=DDPG_NETWORK, dyna=MIRRORED, wrap=WORTH_IT),
        "default-v6": Preset(network=DDPG_NETWORK, dyna=TRIED, wrap=WORTH_IT),
        "default-v7": Preset(network=DDPG_NETWORK, dyna=LET_GO, wrap=WORTH_IT),
        "paper-v1": Preset(
            EnvConfig(clip_actions=False),
            NetworkConfig(
                hidden=(256, 256),
                activation="relu",
                init_std=1.0,
                initialization="uniform",
                squash=True,
                normalize_observation=False,
            ),
            dyna=DynaConfig(
                layer_norm=False,
                critics=1,
                critic_learning_rate=1e-3,
                schedule="fixed",
                updates_per_step=11,
                actor_every=11,
                tau=0.005,
                discount_seconds=None,
                exploration_noise=0.0,
                final_noise=0.0,
                random_steps=0,
                anchor=0.0,
                curious_until=0,
                overrun_steps=128,
                reward_scale=1.0,
                model_share=10 / 11,
                mix_batches=False,
                keep_share=1.0,
                planned_action="replayed",
                planned_reward="minus-norm",
                planned_termination=False,
            ),
            model=ModelConfig(
                members=1,
                hidden=(256, 256),
                layer_norm=False,
                every=1,
                updates=1,
                batch_size=128,
                loss="squared-error",
                predict="state",
                normalize_targets=False,
            ),
            wrap=PAPER_WRAP,
        ),
    },
    "dyna-ppo": {
        # By KL divergence, PPO's default, it learnt less on all of four tuning seeds.
        "default-v1": Preset(ppo=IMAGINED_PPO),
        "default-v2": Preset(ppo=IMAGINED_PPO, wrap=MECHANISM),
        "default-v3": Preset(ppo=IMAGINED_PPO, wrap=UNWEAKENED),
        "default-v4": Preset(ppo=IMAGINED_PPO, wrap=WORTH_IT),
    },
}
"""`default-v1` of PPO was the default until 2026-11-26, `default-v2` to `default-v5` of PPO, `default-v1` and `default-v2` of
the others until 2026-11-28, `default-v6` and `default-v7` of PPO, `default-v3` of the others, `default-v4` to `default-v6` of
DYNA-DDPG until 2026-11-29; `paper-v1` follows the paper's code (docs: departures)."""


def preset_family(version: str) -> str:
    """Name a preset without its version."""
    return version.rpartition("-v")[0]


def preset_version(algo: Algorithm, name: str) -> str:
    """The full name of a preset: `default` and `paper` are their newest versions.

    Raises:
        UnknownNameError: an unknown trainer, or a preset that it does not have.
    """
    if not isinstance(algo, str) or algo not in PRESETS:
        raise UnknownNameError("trainer", str(algo), [*PRESETS])
    versions = PRESETS[algo]
    if name in [*versions]:
        return name
    newest = [version for version in versions if preset_family(version) == name]
    if not newest:
        families = dict.fromkeys(preset_family(version) for version in versions)
        raise UnknownNameError(f"preset of {algo}", str(name), [*families, *versions])
    return max(newest, key=lambda version: int(version.rpartition("-v")[2]))


def preset_of(algo: Algorithm, name: str) -> Preset:
    """Take the settings of a preset.

    Raises:
        UnknownNameError: an unknown trainer, or a preset that it does not have.
    """
    version = preset_version(algo, name)
    return PRESETS[algo][version]


def closest_preset(algo: Algorithm, name: str, sections: Mapping[str, object]) -> str:
    """Find the version of a preset that leaves the fewest settings of these sections to override; the newest of several.

    Records of version 0.1 have the names `default` and `paper` alone.
    """
    if name in PRESETS[algo]:
        return name

    def differing(version: str) -> int:
        preset = PRESETS[algo][version]
        pairs = [(asdict(getattr(preset, section)), vars(sections[section])) for section in USED[algo]]
        return sum(value != given[key] for given, own in pairs for key, value in own.items())

    versions = [version for version in PRESETS[algo] if preset_family(version) == name]
    return min(reversed(versions or list(PRESETS[algo])), key=differing)
