"""Settings of a whole run."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field, fields, replace
from typing import Any

from transferkit.config.dyna import DYNA_PRESETS, DynaConfig
from transferkit.config.names import Algorithm, Preset, check_choices
from transferkit.config.ppo import PPO_PRESETS, PPOConfig
from transferkit.config.wrap import WRAP_PRESETS, WrapConfig
from transferkit.errors import ConfigError


@dataclass(frozen=True)
class TrainConfig:
    """Everything a training run is determined by, besides its budget's clock."""

    env: str
    """Environment id."""
    core: str | None = None
    """Core id or folder; None trains from scratch."""
    member: int = 0
    """Which of the core's source seeds."""
    algo: Algorithm = "ppo"
    """Trainer."""
    preset: Preset = "default"
    """What the other fields were filled from."""
    seed: int = 0
    """Seed of every random stream."""
    episodes: int | None = None
    """Budget in completed episodes."""
    steps: int | None = None
    """Budget in environment steps."""
    seconds: float | None = None
    """Budget in seconds of training."""
    eval_episodes: int = 20
    """Episodes of an evaluation."""
    eval_every: int = 0
    """Environment steps between evaluations, the first before any training; 0 evaluates at the end only."""
    stop_at: float | None = None
    """Mean return of an evaluation, after the first one, that ends training before the budget does."""
    checkpoint_seconds: float = 20.0
    """Least time between checkpoints."""
    device: str = "cpu"
    """Torch device of the networks, `cpu` or `cuda`."""
    experience: tuple[str, ...] = ()
    """dyna-ddpg: recordings (FILE.mcap) and Minari datasets (minari:NAME) to learn from before the first real step."""
    mapping: str | None = None
    """TOML file that names the channels of other tools' recordings."""
    ppo: PPOConfig = field(default_factory=PPOConfig)
    """PPO's settings."""
    dyna: DynaConfig = field(default_factory=DynaConfig)
    """DYNA-DDPG's settings."""
    wrap: WrapConfig = field(default_factory=WrapConfig)
    """The sandwich's settings."""

    def __post_init__(self) -> None:
        check_choices(self)
        if self.eval_episodes < 1:
            raise ConfigError(f"eval_episodes={self.eval_episodes} must be at least 1; pass --eval-episodes N")
        if self.eval_every < 0:
            raise ConfigError(f"eval_every={self.eval_every} must be at least 0; pass --eval-every STEPS")
        if self.stop_at is not None and not self.eval_every:
            raise ConfigError(f"stop_at={self.stop_at:g} is compared with evaluations; pass --eval-every STEPS with it")
        if self.experience and self.algo != "dyna-ddpg":
            raise ConfigError(f"{self.algo} does not learn from recordings; pass --algo dyna-ddpg, or leave out --experience")
        if self.mapping and not self.experience:
            raise ConfigError(f"mapping={self.mapping} has no recordings to read; pass --experience FILE.mcap with it")
        if self.algo == "dyna-ppo" and self.dyna.model_loss != "likelihood":
            raise ConfigError("dyna-ppo needs a model that learns rewards; the paper has no code for it: pass --preset default")

    @classmethod
    def from_json(cls, data: Mapping[str, Any]) -> TrainConfig:
        """What `dataclasses.asdict` made a run's record of; settings that are newer than the record have their defaults."""
        parts = {name: kind(**_tuples(data[name])) for name, kind in PARTS.items()}
        return cls(**_tuples({f.name: data[f.name] for f in fields(cls) if f.name in data} | parts))


PARTS = {"ppo": PPOConfig, "dyna": DynaConfig, "wrap": WrapConfig}


def _tuples(data: Mapping[str, Any]) -> dict[str, Any]:
    """With tuples where JSON has lists."""
    return {name: tuple(value) if isinstance(value, list) else value for name, value in data.items()}


def preset(config: TrainConfig, name: Preset) -> TrainConfig:
    """The configuration with every setting of its trainer and its sandwich as the preset has them."""
    return replace(config, preset=name, ppo=PPO_PRESETS[name], dyna=DYNA_PRESETS[name], wrap=WRAP_PRESETS[name])
